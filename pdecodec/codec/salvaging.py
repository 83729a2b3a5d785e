"""Salvage the undamaged parts of a `.pdeanim` file: every group of frames that decodes, at its original times.

A position at a frame depends only on its own group, the mesh and the reference frame, so damage to a group loses
only that group. If the mesh, the reference frame, the table of groups or the times are damaged, nothing of their run
can be saved.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.codec.decoder import Animation
from pdecodec.codec.mending import mended
from pdecodec.codec.opening import open_animation
from pdecodec.codec.sections.scene import Carrier
from pdecodec.codec.source import DecodeLimits, chosen_limits
from pdecodec.errors import CorruptFileError, LimitError, unreadable
from pdecodec.mesh.arrays import Float32Array, Int64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.runs import ChangingSequence, OpenedRuns
from pdecodec.mesh.sequence import MeshObject, MeshSequence, check_frame_range
from pdecodec.system.reading import open_regular

Frames = tuple[int, int]
"""First frame and end of a range of frames."""


@dataclass(frozen=True)
class Salvage:
    """The result of a salvage.

    Attributes
    ----------
    sequence : MeshSequence
        The frames that can be decoded, at their times; in a file of several runs, only runs with such frames.
    frame_count : int
        Frames of the file.
    missing : tuple of (int, int)
        Frames of the file, from 0, that are not in `sequence`: first, and after the last.
    lost : tuple of str
        Other missing parts, one line each.
    """

    sequence: MeshSequence
    frame_count: int
    missing: tuple[Frames, ...]
    lost: tuple[str, ...]

    @property
    def is_whole(self) -> bool:
        """Whether nothing is missing from the file."""
        return not (self.missing or self.lost)


class SoundFrames(MeshSequence):
    """The frames of a run that can be decoded.

    Parameters
    ----------
    run : Animation
        Stays the caller's.
    frames : (n,) int64 array
        Its frames that can be decoded, increasing.
    objects : tuple of MeshObject
    metadata : mapping of str to str
    fields : mapping of str to list of (int, int)
        Names of the fields to keep, with the frames of the run at which they are damaged: floats are NaN there.
    """

    def __init__(
        self,
        run: Animation,
        frames: Int64Array,
        objects: tuple[MeshObject, ...],
        metadata: Mapping[str, str],
        fields: Mapping[str, list[Frames]],
    ) -> None:
        self._run, self._frames, self._without = run, frames, fields
        self.fields = tuple(one for one in run.fields if one.name in fields) if fields else ()
        self.objects, self.metadata, self.notices = objects, metadata, ()
        self.times, self.fps = run.times[frames], run.fps

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        return self._run.sample(self.times[start:stop])

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        values = np.full(field.shape(stop - start, self.objects), 0 if field.is_exact else np.nan, field.dtype)
        for row, frame in enumerate(self._frames[start:stop].tolist()):
            if not any(first <= frame < end for first, end in self._without[field.name]):
                values[row] = self._run.read_field(field.name, frame, frame + 1)[0]
        return values


@contextmanager
def salvage(path: str | os.PathLike[str], *, limits: DecodeLimits | None = None) -> Iterator[Salvage]:
    """Salvage the undamaged parts of a file, for use within a ``with`` statement.

    Every group of frames is decoded once to test it, and again when its frames are read.

    Parameters
    ----------
    path : path-like
    limits : DecodeLimits, optional

    Yields
    ------
    Salvage
        Its sequence is closed with the file, when the block ends.

    Raises
    ------
    CorruptFileError
        If nothing can be saved; the message says why.
    LimitError
        If decoding the file would take more memory than `limits` allow.
    InputError
        If it cannot be opened or read.
    """
    limits = chosen_limits(limits)
    with ExitStack() as stack:
        try:
            file = stack.enter_context(open_regular(path))
        except OSError as error:
            raise unreadable(error, path, doing="opened") from error
        try:
            view, _, _ = mended(file, os.fspath(path), limits.max_memory)
            animation = stack.enter_context(open_animation(view, limits=limits))
            saved = _Saved(animation, limits)
        except LimitError:
            raise
        except CorruptFileError as error:
            raise error.placed(f"nothing can be saved: {error.message}", path=path) from error
        yield Salvage(saved.sequence(), animation.frame_count, saved.missing, saved.lost)


class _Saved:
    """The runs of an animation that can be decoded at least in part, and a list of the parts that cannot."""

    def __init__(self, animation: Animation, limits: DecodeLimits) -> None:
        self.animation = animation
        self.frames: dict[int, Int64Array] = {}
        self._fields: dict[int, dict[str, list[Frames]]] = {}
        self._missing: list[Frames] = []
        self._lost: dict[str, None] = {}
        try:
            self.metadata = animation.metadata
        except CorruptFileError as error:
            self.metadata = {}
            self._lost[f"metadata ({error.message})"] = None
        self._scene: Carrier | None = None
        try:
            if (scene := animation.carried) is not None:
                scene.files(limits.max_memory)
                self._scene = scene
        except LimitError:
            raise
        except CorruptFileError as error:
            self._lost[f"the scene around the motion ({error.message})"] = None
        starts = animation.run_starts.tolist()
        faults: list[CorruptFileError] = []
        for number, (first, end) in enumerate(zip(starts, [*starts[1:], animation.frame_count], strict=True)):
            try:
                run = self._run(number)
                _ = run.meshes
            except LimitError:
                raise
            except CorruptFileError as error:
                self._missing.append((first, end))
                faults.append(error)
                continue
            self._take(run, number, first, faults)
        if not self.frames:
            raise faults[0]

    def _run(self, number: int) -> Animation:
        run = self.animation.runs[number]
        assert isinstance(run, Animation)
        return run

    def _take(self, run: Animation, number: int, first: int, faults: list[CorruptFileError]) -> None:
        sound = []
        for group, (begin, end) in enumerate(run.group_frames):
            try:
                run.check_group(group)
                run.positions(float(run.times[begin]))
            except LimitError:
                raise
            except CorruptFileError as error:
                self._missing.append((first + begin, first + end))
                faults.append(error)
            else:
                sound.append(np.arange(begin, end))
        if sound:
            self.frames[number] = np.concatenate(sound)
            self._objects(run)
            self._fields[number] = self._sound_fields(run, first)

    def _sound_fields(self, run: Animation, first: int) -> dict[str, list[Frames]]:
        """Return the fields of a run that can be kept, each with its damaged frames."""
        try:
            stored = run.stored_fields
        except LimitError:
            raise
        except CorruptFileError as error:
            self._lost[f"fields ({error.message})"] = None
            return {}
        kept: dict[str, list[Frames]] = {}
        for number, field in enumerate(run.fields):
            damaged = []
            for index, group in enumerate(stored[number].groups):
                try:
                    run.check_field_group(number, index, deep=True)
                except LimitError:
                    raise
                except CorruptFileError:
                    damaged.append((group.first, group.first + group.frames))
            places = ", ".join(f"{first + begin} to {first + end - 1}" for begin, end in damaged)
            if not damaged or (not field.is_exact and len(damaged) < len(stored[number].groups)):
                kept[field.name] = damaged
                if damaged:
                    self._lost[f"field {field.name!r} at frames {places}, where its values are NaN"] = None
            else:
                self._lost[f"field {field.name!r} (damaged at frames {places})"] = None
        return kept

    def _objects(self, run: Animation) -> tuple[MeshObject, ...]:
        """Return the objects of a run, without damaged attributes."""
        try:
            return run.objects
        except LimitError:
            raise
        except CorruptFileError as error:
            self._lost[f"attributes ({error.message})"] = None
            return run.meshes

    @property
    def missing(self) -> tuple[Frames, ...]:
        """Ranges of missing frames, joined where they are consecutive."""
        joined: list[Frames] = []
        for first, end in self._missing:
            if joined and joined[-1][1] == first:
                first = joined.pop()[0]
            joined.append((first, end))
        return tuple(joined)

    @property
    def lost(self) -> tuple[str, ...]:
        """Descriptions of the parts that are missing, other than frames."""
        return tuple(self._lost)

    def sequence(self) -> MeshSequence:
        numbers = [*self.frames]
        if len(numbers) == 1:
            return self._sound(numbers[0])
        assert isinstance(self.animation, ChangingSequence)
        starts = self.animation.run_starts
        return ChangingSequence(
            OpenedRuns(lambda index: self._sound(numbers[index]), len(numbers)),
            times=self.animation.times[np.concatenate([starts[number] + self.frames[number] for number in numbers])],
            frames=[self.frames[number].size for number in numbers],
            vertices=[int(self.animation.run_vertices[number]) for number in numbers],
            fps=self.animation.fps,
            metadata=self.metadata,
            notices=self.animation.notices,
        )

    def _sound(self, number: int) -> SoundFrames:
        run = self._run(number)
        found = SoundFrames(run, self.frames[number], self._objects(run), self.metadata, self._fields[number])
        found.notices = self.animation.notices
        if run is self.animation:
            found.carried = self._scene
        return found
