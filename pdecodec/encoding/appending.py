"""Frames coded with the reference frame and the space basis of a file, so that they can stand in it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from pdecodec.coding.groups import GroupEntry
from pdecodec.coding.residuals import LAST_BINADE, SAFETY
from pdecodec.coding.spacebasis import SpaceBasis
from pdecodec.decoder import Animation
from pdecodec.encoding.autoprofile import AutoEncoder, EncodedPart
from pdecodec.encoding.groupfit import EncodedGroup, GroupChoice
from pdecodec.encoding.quantisation import grid_index
from pdecodec.sequence import MeshSequence, Progress
from pdecodec.settings import EffortName, EncodeSettings


def bound_of(animation: Animation, residual_step: float) -> float:
    """The bound [scene units] that a file was encoded with: what its step of residuals keeps.

    Parameters
    ----------
    animation : Animation
        Of profile "auto".
    residual_step : float [scene units]
        Of its model.
    """
    # Undoes pdecodec.coding.residuals.residual_step; where float32 is so coarse that a quarter of its spacing is the
    # step, the least bound that has it.
    largest = float(np.abs(animation.read_frames(0, 1)).max())
    spacing = float(np.spacing(np.float32(min(largest, LAST_BINADE))))
    return math.sqrt(3.0) / 2.0 * (residual_step / SAFETY + spacing)


class AppendingEncoder(AutoEncoder):
    """One encode of frames that go into a file, within the bound of the file.

    Parameters
    ----------
    sequence : MeshSequence
        Of the file's mesh.
    animation : Animation
        The file.
    last : GroupEntry
        The group that is tried first: mostly the last one of the file.
    residual_step : float [scene units]
        Of the file's model.
    effort : {"fast", "default", "best"}
    progress : callable, optional
    """

    def __init__(
        self,
        sequence: MeshSequence,
        animation: Animation,
        last: GroupEntry,
        residual_step: float,
        *,
        effort: EffortName = "default",
        progress: Progress | None = None,
    ) -> None:
        bound = bound_of(animation, residual_step)
        super().__init__(sequence, EncodeSettings(max_error=bound, effort=effort), progress)
        self._first = animation.read_frames(0, 1)[0]
        self._residual_step = residual_step
        self._unit = max(bound, float(np.spacing(np.float32(min(float(np.abs(self._first).max()), LAST_BINADE)))))
        self._reference, self._basis = animation.reference_and_space()
        time = "trajectories" if last.basis == "closed form" or not last.functions else last.basis
        self._usual = GroupChoice(time, "reference", grid_index(last.step))

    @property
    def _space(self) -> SpaceBasis:
        return self._basis

    def _first_parts(self, steps: Mapping[str, float]) -> list[EncodedPart]:
        """Parts of the first group, in the model that is there."""
        self._ranges = self._group_ranges(self._plan.group_frames)
        return self._divided(self._fitter(*self._ranges[0], steps), self._usual)

    @property
    def jumps(self) -> Sequence[int]:
        """Frames that motion jumps to, once all are coded."""
        return self._jumps()

    def coded(self) -> Iterator[EncodedGroup]:
        """Its groups in order, as they are written."""
        frames = 0
        for group in self._groups():
            yield group
            frames += group.entry.frames
            if self._progress:
                self._progress(frames, self._sequence.frame_count, "encoding")
