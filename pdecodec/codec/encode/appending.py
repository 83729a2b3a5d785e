"""Frames coded with the reference frame and the space basis of a file, so that they can stand in it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from pdecodec.codec.decoder import Animation
from pdecodec.codec.encode.auto_profile import AutoEncoder, EncodedPart
from pdecodec.codec.encode.group_fit import EncodedGroup, GroupChoice
from pdecodec.codec.encode.quantisation import grid_index
from pdecodec.codec.encode.report import GENERATOR
from pdecodec.codec.sections.groups import GroupEntry
from pdecodec.codec.sections.residuals import LAST_BINADE, SAFETY
from pdecodec.codec.sections.space_basis import SpaceBasis
from pdecodec.codec.settings import SMALLEST_BOUND, EffortName, EncodeSettings
from pdecodec.errors import SettingsError
from pdecodec.mesh.sequence import MeshSequence, Progress


def bound_of(animation: Animation) -> float | None:
    """The bound [scene units] that a file was encoded with, or a little less; None where it says that there was none.

    What its step of residuals keeps, where a single bound has that step. Where float32 is so coarse that all bounds
    below some have the same, what the file's remarks say; without them it may have been the least one there is.
    """
    reference, _ = animation.reference_and_space()
    # The frame that the encoder saw is up to half a step away on each axis.
    points, half = reference.points, reference.step / 2.0
    largest = float(np.abs(points).max())
    near, far = (float(np.spacing(np.float32(min(max(0.0, largest + more), LAST_BINADE)))) for more in (-half, half))
    # Undoes pdecodec.codec.sections.residuals.residual_step.
    of_step = math.sqrt(3.0) / 2.0 * (animation.residual_step / SAFETY + near)
    settings, is_alone = _recorded(animation), animation.residual_step > far / 4.0
    if settings is None:
        return of_step if is_alone else SMALLEST_BOUND
    diagonal = math.hypot(*np.ptp(points, axis=0).tolist())
    said = settings.bound(max(0.0, diagonal - 2.0 * math.sqrt(3.0) * half))
    if said is None:
        return None
    # A tolerance is of a diagonal that is only about known here.
    return of_step if is_alone and settings.max_error is None else min(said, of_step)


def _recorded(animation: Animation) -> EncodeSettings | None:
    """The settings that a file's remarks say it was made with, if they do."""
    information = animation.info()
    if not information["generator"].startswith(GENERATOR):
        return None  # Of settings, those that are as usual are not recorded: others' remarks would say the usual ones.
    try:
        return EncodeSettings.from_json(information["settings"])
    except (SettingsError, TypeError):
        return None


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
        bound = bound_of(animation)
        if bound is None:
            raise SettingsError("was encoded without a bound, within which frames could be coded", path=animation.path)
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
