"""Read OBJ sequences: one Wavefront OBJ file per frame, in parallel.

Frames with the same faces, lines and UV indices form a run. Names and hard edges come from its first frame; UVs and
colours that change are fields. Each kind of other difference is reported once.

OBJ has no time. Our writer starts each file with a comment that states time and frame rate; other readers skip it.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec._core import ObjScan, ObjStructure
from pdecodec.errors import InputError
from pdecodec.formats.base.attribute_roles import COLOR, UV, is_by_vertex, rows_or_nan
from pdecodec.formats.base.frame_changes import FrameChanges
from pdecodec.formats.base.frame_data import DataKey
from pdecodec.formats.base.frame_files import FrameFiles, find_frames
from pdecodec.formats.base.frame_meshes import runs_of_frames
from pdecodec.formats.base.kept_frames import KeptData, KeptPositions
from pdecodec.formats.base.registry import read_errors
from pdecodec.formats.base.stored_normals import Pose, spread, turned_in_pose, turned_notices, with_shared
from pdecodec.formats.base.times import Timing, timing_of_numbers
from pdecodec.formats.obj.model import ObjModel
from pdecodec.formats.obj.text import (
    NoVerticesError,
    ObjText,
    is_rounding_noticeable,
    read_text,
    rounding_of_text,
    scan,
)
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.rounding import is_rounding_noticed, note_rounding
from pdecodec.mesh.sequence import Content, MeshObject, MeshSequence, check_frame_range
from pdecodec.mesh.times import check_times

MAX_THREADS = 8
"""Largest number of threads that read frames; with more, disk and memory bus are the limit."""


PARALLEL_BYTES = 256 * 1024
"""Size of the first frame below which one thread reads all frames: distributing them would cost more than it saves."""


COMMENT_BYTES = 128
"""Bytes at the start of each file that are searched for the time comment."""


_COMMENT = re.compile(rb"# time ([-+.\deE]{1,30}) s at ([-+.\deE]{1,30}) frames per second\r?\n")


_VERTEX_ENDS, _TEXTURES, _LIBRARIES = 1, 2, 4
"""Data that the core compares, as bits: values after positions, texture vertices, mtllib."""


_LOOKS = {"vertex colours": COLOR, "UVs": UV}
"""Names of fields by the kinds of data that change."""


_BITS = {"vertex colours": _VERTEX_ENDS, "UVs": _TEXTURES, "names of mtllib": _LIBRARIES}


def open_obj(path: Path, *, fps: float | None = None, threads: int | None = None) -> MeshSequence:
    """Open an OBJ file, frame pattern or folder; every frame is read once to find where faces change.

    Parameters
    ----------
    path : pathlib.Path
        See :func:`pdecodec.formats.base.frame_files.find_frames`.
    fps : float or None
        Frames per second; None takes the rate that our writer recorded, else 24 with a notice.
    threads : int, optional
        Number of reading threads, which does not affect the result. Default: one per processor, at most eight; one if
        frames are small.

    Raises
    ------
    InputError
        If frames are missing, or the first one cannot be used.
    """
    files = find_frames(path, ".obj")
    timing = _timing(files, fps)
    frames = _ObjFrames(files.paths, threads)
    starts, (times, rate, notices) = frames.run_starts(), timing
    told = (*notices, *frames.changes.notices(len(starts)))
    sequence = runs_of_frames(starts, (times, rate, told), lambda first, own: ObjSequence(frames, first, own))
    sequence.list_contents = lambda: frames.contents(sequence.runs[0])
    return sequence


class _ObjFrames:
    """Files of frames, the number of reading threads, and positions kept from comparing frames."""

    def __init__(self, paths: Sequence[Path], threads: int | None) -> None:
        self.paths, self._kept, self.changes = paths, KeptPositions(), FrameChanges()
        self._looks: dict[int, set[str]] = {}
        self._opened: dict[int, _Structure] = {}
        with read_errors(paths[0]):
            is_large = paths[0].stat().st_size >= PARALLEL_BYTES
        self.threads = threads or (min(MAX_THREADS, os.cpu_count() or 1) if is_large else 1)

    def run_starts(self) -> list[tuple[int, int]]:
        """Return the first frame and the vertex count of each run; unreadable frames raise only when they are read."""
        starts: list[tuple[int, int]] = []
        structure: _Structure | None = None
        frame, at_once = 0, 1
        with ThreadPoolExecutor(self.threads) as pool:
            while frame < len(self.paths):
                if structure is None:
                    text = read_text(self.paths[frame], frame)
                    try:
                        structure, at_once = _Structure(text), 1
                        if not self._opened:
                            self._opened[frame] = structure
                        starts.append((frame, structure.vertices))
                        self.changes.note_lines(structure.model.notices)
                        self._kept.keep(frame, structure.positions)
                    except NoVerticesError:
                        if len(self.paths) == 1:
                            raise
                        starts.append((frame, 0))
                    frame += 1
                    continue
                batch = range(frame, min(frame + at_once, len(self.paths)))
                compared = pool.map(partial(self._compare_frame, structure), batch)
                for index, (points, model) in zip(batch, compared, strict=True):
                    if points is None:
                        structure = None
                        break
                    if model is not None:
                        found = structure.note_changes(model, index, self.changes)
                        self._looks.setdefault(starts[-1][0], set()).update(found)
                    self._kept.keep(index, points)
                    frame += 1
                at_once = min(2 * at_once, 2 * self.threads)
        return starts

    def contents(self, run: MeshSequence) -> tuple[Content, ...]:
        """List what the files hold, for a sequence or its first run."""
        assert isinstance(run, ObjSequence)
        return (*run.model.contents(), *self.changes.contents(run))

    def looks(self, first: int) -> set[str]:
        """Return the names of the UVs and colours that change in the run that begins with a frame."""
        return self._looks.get(first, set())

    def structure(self, first: int) -> _Structure:
        """Return the structure of the run that begins with a frame; that of the first run is cached."""
        return self._opened.get(first) or _Structure(read_text(self.paths[first], first))

    def _compare_frame(self, structure: _Structure, frame: int) -> tuple[Float32Array | None, ObjModel | None]:
        """Compare a frame with a run; return its positions, and its model if other data may have changed.

        Positions are empty if the frame cannot be read, and None if its faces differ.
        """
        points = np.empty((structure.vertices, 3), np.float32)
        try:
            return points, structure.read_positions(self.paths[frame], frame, points, compare=True)
        except (_ChangedError, NoVerticesError):
            return None, None
        except InputError:
            return points[:0], None

    def read(self, structure: _Structure, frame: int, points: Float32Array) -> None:
        """Read a frame's positions into `points`, (vertices, 3) float32; raises as `structure` does."""
        kept = self._kept.get(frame)
        if kept is None or len(kept) != len(points):
            structure.read_positions(self.paths[frame], frame, points)
        else:
            points[:] = kept

    def note_rounding(self, frame: int, points: Float32Array) -> None:
        """Read the text of a frame again and note how far float32 positions (vertices, 3) are from it."""
        if is_rounding_noticeable(points):
            note_rounding(rounding_of_text(read_text(self.paths[frame], frame), points))


class ObjSequence(MeshSequence):
    """Consecutive frames of one connectivity, read on demand."""

    def __init__(self, frames: _ObjFrames, first: int, timing: Timing) -> None:
        self._frames, self._first = frames, first
        self._structure = frames.structure(first)
        self.model = self._structure.model
        self.times, self.fps, self.notices = timing
        self.metadata = self.model.metadata
        self._looks = frames.looks(first)
        self.objects = self._with_shared(
            [
                replace(item, attributes=tuple(one for one in item.attributes if one.name not in self._looks))
                for item in self.model.objects
            ]
        )
        turned = [turned_in_pose(item, pose) for item, pose in zip(self.objects, self.model.poses(), strict=True)]
        self.notices = (*self.notices, *turned_notices(turned))
        self.fields = tuple(_look_fields(self.model.objects, self._looks))
        self._values = KeptData()

    def _with_shared(self, items: Sequence[MeshObject]) -> tuple[MeshObject, ...]:
        """Return objects with the vertices that share a normal in some frames, from the first one on."""
        first = list(self.model.poses())

        @cache
        def later() -> list[list[Pose]]:
            found = []
            with suppress(InputError):  # The error is raised when the frame is read.
                for frame in spread(range(self._first, self._first + self.times.size)):
                    text = read_text(self._frames.paths[frame], frame)
                    found.append(list(ObjModel(text, scan(text)).poses()))
            return [one for one in found if len(one) == len(first)]

        def poses(index: int) -> Iterator[Pose]:
            yield first[index]
            yield from (one[index] for one in later())

        return tuple(with_shared(item, poses(index)) for index, item in enumerate(items))

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        values = np.empty(field.shape(stop - start, self.objects), field.dtype)
        for frame in range(start, stop):
            key = field.domain, field.name
            found = self._values.get(frame, key) if frame in self._values else self._read_looks(frame)[key]
            values[frame - start] = found
        return values

    def _read_looks(self, frame: int) -> dict[DataKey, NDArray[Any]]:
        """Return the rows of all fields at a frame. They are kept, so that the frame's file is parsed only once."""
        text = read_text(self._frames.paths[self._first + frame], self._first + frame)
        objects = ObjModel(text, scan(text)).objects
        rows: dict[DataKey, NDArray[Any]] = {
            (field.domain, field.name): _look_rows(field, objects, self.model.objects) for field in self.fields
        }
        if self._values.has_room(sum(one.nbytes for one in rows.values()), self.frame_count):
            self._values.keep(frame, rows)
        return rows

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = np.empty((stop - start, self.vertex_count, 3), np.float32)

        def read(frame: int) -> None:
            self._frames.read(self._structure, self._first + frame, points[frame - start])

        with ThreadPoolExecutor(max_workers=min(self._frames.threads, max(1, stop - start))) as pool:
            # map yields results in order, so the first bad frame raises
            for _ in pool.map(read, range(start, stop)):
                pass
        if is_rounding_noticed():
            for frame, found in enumerate(points, self._first + start):
                self._frames.note_rounding(frame, found)
        return points


def _look_fields(objects: Sequence[MeshObject], names: Collection[str]) -> Iterator[Field]:
    """Yield the fields for attributes of the given names that change."""
    for name in sorted(names):
        owners = [index for index, item in enumerate(objects) if any(one.name == name for one in item.attributes)]
        found = [next(one for one in objects[index].attributes if one.name == name) for index in owners]
        if not found:
            continue
        by_vertex = name == UV and all(
            is_by_vertex(one, objects[index].connectivity) for one, index in zip(found, owners, strict=True)
        )
        width = max(one.values.shape[1] for one in found)
        everywhere = None if len(owners) == len(objects) else tuple(owners)
        domain = found[0].domain if name != UV or not by_vertex else "vertex"
        yield Field(name, domain, found[0].values.dtype, width, objects=everywhere)


def _look_rows(field: Field, objects: Sequence[MeshObject], like: Sequence[MeshObject]) -> NDArray[Any]:
    """Return the rows of a field in the objects of one frame: NaN where the frame has no values or another
    number of them.
    """
    parts = []
    for index, count in enumerate(field.row_counts(like)):
        rows = np.full((count, field.components), np.nan, field.dtype)
        own = objects[index].attributes if len(objects) == len(like) else ()
        one = next((one for one in own if one.name == field.name), None)
        if one is not None and count:
            values = one.values if field.domain == "vertex" else rows_or_nan(one)
            if len(values) == count:
                rows[:, : values.shape[1]] = values[:, : field.components]
        parts.append(rows)
    return np.concatenate(parts)


class _ChangedError(InputError):
    """A frame has different faces than the run."""


class _Structure:
    """The data that must not change within a run: as bytes for a fast comparison, as indices for an exact one."""

    def __init__(self, text: ObjText) -> None:
        self._lines, self._first = ObjStructure(text.data), scan(text)
        self.vertices: int = self._first.vertex_count
        self.model = ObjModel(text, self._first)
        self._unchanged = _VERTEX_ENDS | _TEXTURES | _LIBRARIES

    @property
    def positions(self) -> Float32Array:
        """Positions (vertices, 3) of the first frame."""
        found: Float32Array = self._first.positions
        return found

    def note_changes(self, model: ObjModel, frame: int, changes: FrameChanges) -> set[str]:
        """Record other differences of a frame, except in kinds of data that are known to change.

        Return the names of UVs and colours that differ: they are fields.
        """
        changes.note_lines(model.notices)
        looks = set()
        for kind, is_in_first in self.model.changes_to(model):
            if kind in _LOOKS and is_in_first:
                looks.add(_LOOKS[kind])
            else:
                changes.note(frame, kind, is_in_first=is_in_first)
            self._unchanged &= ~_BITS.get(kind, 0)
        return looks

    def read_positions(self, path: Path, frame: int, points: Float32Array, *, compare: bool = False) -> ObjModel | None:
        """Read a frame's positions into `points`, (vertices, 3) float32.

        Returns
        -------
        ObjModel or None
            Model of the frame, if `compare` is true and its other data may have changed.

        Raises
        ------
        InputError
            If the file is unusable or its connectivity differs.
        """
        text = read_text(path, frame)
        found = self._lines.read_positions(text.data, points)
        if found is not None:
            unread, changed = found
            text.read_rest(unread, points)
            return ObjModel(text, scan(text)) if compare and changed & self._unchanged else None
        # The frame's text differs; its content may still be the same.
        other = scan(text)
        model = ObjModel(text, other)  # refuses statements that carry geometry
        difference = self._difference(other)
        if difference:
            raise _ChangedError(f"{difference}; the file changed while it was read", path=path, frame=frame)
        points[:] = other.positions
        return model

    def _difference(self, other: ObjScan) -> str | None:
        first = self._first
        if other.vertex_count != first.vertex_count:
            return f"there are {other.vertex_count} vertices, the first frame has {first.vertex_count}"
        sizes, elements = first.element_sizes, other.element_sizes.size
        if elements != sizes.size:
            return f"there are {elements} faces, lines and points, the first frame has {sizes.size}"
        changed = np.flatnonzero((other.element_sizes != sizes) | (other.is_face != first.is_face))
        if changed.size:
            return f"face, line or point {changed[0]} has another size or kind than in the first frame"
        unlike = other.corners[:, :2] != first.corners[:, :2]
        corners = np.flatnonzero(unlike.any(axis=1))
        if corners.size:
            element = int(np.searchsorted(np.cumsum(sizes), corners[0], side="right"))
            what = "vertices" if unlike[corners[0], 0] else "texture vertices"
            return f"face, line or point {element} has other {what} than in the first frame"
        return None


def _timing(files: FrameFiles, fps: float | None) -> Timing:
    """Return times from the files' comments if all have one and `fps` is None, else frame numbers divided by `fps`."""
    if fps is None:
        told = [_read_comment(path) for path in files.paths]
        known = [item for item in told if item is not None]
        if len(known) == len(told):
            return *check_times(len(known), [time for time, _ in known], known[0][1]), ()
    return timing_of_numbers(files.numbers, fps)


def _read_comment(path: Path) -> tuple[float, float] | None:
    with read_errors(path), path.open("rb") as file:
        match = _COMMENT.match(file.read(COMMENT_BYTES))
    try:
        time, rate = (math.nan, math.nan) if match is None else (float(match[1]), float(match[2]))
    except ValueError:
        return None
    return (time, rate) if math.isfinite(time) and 0 < rate < math.inf else None
