"""Encode further frames with the reference frame and the space basis of an existing file, so that they can be
added to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from pdecodec.codec.decoder import Animation
from pdecodec.codec.encode.fit import Candidate, EncodedGroup
from pdecodec.codec.encode.pipeline import AutoEncoder, EncodedPart, owner_of
from pdecodec.codec.encode.quantise import grid_index
from pdecodec.codec.sections.groups import GroupEntry
from pdecodec.codec.sections.residuals import LAST_BINADE
from pdecodec.codec.sections.space_basis import SpaceBasis
from pdecodec.codec.settings import EffortName, EncodeSettings
from pdecodec.codec.stored_choices import bound_of
from pdecodec.errors import InputError, SettingsError
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import MeshSequence, Progress


class AppendingEncoder(AutoEncoder):
    """An encode of frames that are added to a file, within the bound of that file.

    Parameters
    ----------
    sequence : MeshSequence
        With the mesh of the file.
    animation : Animation
        The file.
    last : GroupEntry
        The group whose choices are tried first: usually the file's last one.
    residual_step : float [scene units]
        As in the file's model.
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
            raise SettingsError("was encoded without a bound, which is needed to add frames", path=animation.path)
        super().__init__(sequence, EncodeSettings(max_error=bound, effort=effort), progress)
        self._first = animation.read_frames(0, 1)[0]
        self._residual_step = residual_step
        self._unit = max(bound, float(np.spacing(np.float32(min(float(np.abs(self._first).max()), LAST_BINADE)))))
        self._reference, self._basis = animation.reference_and_space()
        self._ties = self._reference.ties
        time = "trajectories" if last.basis == "closed form" or not last.functions else last.basis
        self._usual = Candidate(time, "reference", grid_index(last.step))

    @property
    def _space(self) -> SpaceBasis:
        return self._basis

    def _read(self, begin: int, end: int) -> Float32Array:
        points = super()._read(begin, end)
        tied = self._reference.tied
        apart = (points[:, tied] != points[:, self._ties[tied]]).any(axis=2)
        if apart.any():
            frame, index = np.argwhere(apart)[0].tolist()
            one, other = (
                "vertex {1} of object '{0}'".format(*owner_of(self._sequence, int(vertex)))
                for vertex in (self._ties[tied[index]], tied[index])
            )
            raise InputError(
                f"{one} and {other} coincide in every frame of the file, but not here; "
                "encode all frames together from their source",
                code="object-mismatch",
                frame=begin + frame,
            )
        return points

    def _first_parts(self, steps: Mapping[str, float]) -> list[EncodedPart]:
        """Parts of the first group, coded in the model of the file."""
        self._ranges = self._group_ranges(self._plan.group_frames)
        return self._divided(self._fitter(*self._ranges[0], steps), self._usual)

    @property
    def jumps(self) -> Sequence[int]:
        """Frames before which the motion is discontinuous, once all frames are coded."""
        return self._jumps()

    def coded(self) -> Iterator[EncodedGroup]:
        """The groups in order, as they are written."""
        frames = 0
        for group in self._groups():
            yield group
            frames += group.entry.frames
            if self._progress:
                self._progress(frames, self._sequence.frame_count, "encoding")
