"""Read meshes from one file per frame, as several runs if connectivity changes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged
from pdecodec.formats.base.attribute_roles import ID
from pdecodec.formats.base.frame_changes import FrameChanges, not_kept
from pdecodec.formats.base.frame_data import DataKey, StoredData, fields_of_frames, joined_data
from pdecodec.formats.base.frame_files import find_frames
from pdecodec.formats.base.frame_looks import ChangingLooks, looks_of_frame
from pdecodec.formats.base.kept_frames import KeptData, KeptPositions, Positions
from pdecodec.formats.base.stored_normals import Pose, spread, turned_in_pose, turned_notices, with_shared
from pdecodec.formats.base.times import Timing, timing_of_numbers
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.fields import Field, rows_of_domain
from pdecodec.mesh.rounding import to_float32
from pdecodec.mesh.runs import ChangingSequence, OpenedRuns
from pdecodec.mesh.sequence import (
    Attribute,
    Connectivity,
    MeshObject,
    MeshSequence,
    check_frame_range,
    joined_connectivity,
)


@dataclass(frozen=True)
class MeshFile:
    """The content of one file: positions (vertices, 3) as they are stored, data that must be the same in every
    frame, data that may change, and normals (vertices, 3), which only tell which vertices share one.
    """

    points: Positions
    connectivity: Connectivity
    attributes: tuple[Attribute, ...] = ()
    notices: tuple[str, ...] = ()
    data: Mapping[DataKey, StoredData] = field(default_factory=dict, compare=False)
    normals: NDArray[Any] | None = field(default=None, compare=False)

    def normals_of_corners(self) -> Float64Array | None:
        """Return the normals of corners (corners, 3); None without normals."""
        return None if self.normals is None else self.normals[self.connectivity.face_indices].astype(np.float64)

    def continues(self, other: MeshFile) -> bool:
        """Return whether another mesh has the same faces, lines and cells, and the same vertices if they have ids."""
        mine, theirs = (next((one.values for one in mesh.attributes if one.name == ID), None) for mesh in (self, other))
        if (mine is None) != (theirs is None):
            return False
        is_same = mine is None or theirs is None or np.array_equal(mine, theirs)
        return is_same and self.connectivity.same_as(other.connectivity)


def joined_meshes(parts: list[MeshFile]) -> MeshFile:
    """Join several meshes, part after part; attributes are dropped, because each belongs to a single part."""
    if len(parts) == 1:
        return parts[0]
    if any(part.connectivity.cell_count for part in parts):
        parts = [_with_cells(part) for part in parts]
    connectivity = joined_connectivity([part.connectivity for part in parts])
    names = dict.fromkeys(one.name for part in parts for one in part.attributes)
    notices = dict.fromkeys(notice for part in parts for notice in part.notices)
    lost = (f"not kept, because the file has several parts: {', '.join(names)}",) if names else ()
    points = np.concatenate([part.points for part in parts])
    data = joined_data(
        [(part.data, {"vertex": len(part.points), "face": part.connectivity.face_count}) for part in parts]
    )
    return MeshFile(points, connectivity, (), (*notices, *lost), data)


def _with_cells(part: MeshFile) -> MeshFile:
    """Return a mesh whose faces and lines are cells, for joining with parts that have cells."""
    shown = part.connectivity
    if shown.cell_count:
        return part
    data: dict[DataKey, StoredData] = {
        ("cell" if domain == "face" else domain, name): one
        for (domain, name), one in part.data.items()
        if domain != "face" or not shown.line_count  # Lines have no data here.
    }
    return replace(part, connectivity=shown.with_own_cells(), data=data)


class FrameMeshes:
    """The meshes of the files of all frames.

    Parameters
    ----------
    files : sequence of sequences of pathlib.Path
        The files of each frame, mostly one.
    read : callable
        Returns the mesh of a file, or raises InputError.
    """

    def __init__(self, files: Sequence[Sequence[Path]], read: Callable[[Path], MeshFile]) -> None:
        self.files, self._read = tuple(map(tuple, files)), read
        self._kept, self.changes = KeptPositions(), FrameChanges()
        self._data: list[Mapping[DataKey, tuple[np.dtype[Any], int]]] = []
        self._looks: dict[int, dict[str, tuple[DataKey, Field]]] = {}
        self._values = KeptData()
        self._not_joined: dict[str, None] = {}

    def mesh(self, frame: int) -> MeshFile:
        parts = [self._read(path) for path in self.files[frame]]
        mesh = joined_meshes(parts)
        self._not_joined.update((key[1], None) for part in parts for key in part.data if key not in mesh.data)
        return mesh

    def points(self, frame: int, connectivity: Connectivity) -> Positions:
        """Return the positions of a frame; raise InputError if it has another connectivity."""
        found = self._kept.get(frame)
        if found is None or len(found) != connectivity.vertex_count:
            mesh = self.mesh(frame)
            self._check(frame, mesh, connectivity)
            found = mesh.points
        return found

    def _check(self, frame: int, mesh: MeshFile, connectivity: Connectivity) -> None:
        if not mesh.connectivity.same_as(connectivity):
            raise InputError(
                f"{_difference(mesh.connectivity, connectivity)}; the file changed while it was read",
                code="file-changed",
                path=self.files[frame][0],
                frame=frame,
            )

    def fields(self, first: int, frames: int) -> dict[str, tuple[DataKey, Field]]:
        """Return the fields of the frames of a run by name, each with the key of its data."""
        return {**self.looks(first), **fields_of_frames(self._data[first : first + frames])[0]}

    def looks(self, first: int) -> dict[str, tuple[DataKey, Field]]:
        """Return UVs and colours that change in the run that begins with a frame, as :meth:`fields` does."""
        return self._looks.get(first, {})

    def values(
        self, frame: int, key: DataKey, wanted: Iterable[DataKey], connectivity: Connectivity
    ) -> NDArray[Any] | None:
        """Return data of a frame (rows, components), None if it lacks them.

        All `wanted` data are decoded and kept, so that the file is parsed only once. If they do not fit, or some of
        them are damaged, only the requested data are decoded.
        """
        if frame in self._values:
            return self._values.get(frame, key)
        mesh = self.mesh(frame)
        self._check(frame, mesh, connectivity)
        stored = {**looks_of_frame(mesh.attributes, mesh.connectivity), **mesh.data}
        there = {one: stored[one] for one in wanted if one in stored}
        item = MeshObject("", connectivity)
        size = sum(rows_of_domain(item, domain) * one.row_bytes for (domain, _), one in there.items())
        if self._values.has_room(size, len(self.files)):
            with suppress(InputError):  # The error is raised when the damaged data are requested.
                values = {one: data.read() for one, data in there.items()}
                self._values.keep(frame, values)
                return values.get(key)
        return there[key].read() if key in there else None

    def run_starts(self) -> list[tuple[int, int]]:
        """Return the first frame and vertex count of each run of frames that have the same faces, lines and ids.

        Raises an error only if a first frame cannot be read; errors of other frames are raised when these are read.
        """
        starts: list[tuple[int, int]] = []
        found: list[ChangingLooks] = []
        before: MeshFile | None = None
        for frame in range(len(self.files)):
            try:
                mesh = self.mesh(frame)
            except InputError:
                if frame == 0:
                    raise
                self._data.append(self._data[-1])
                continue
            data = {key: one.kind for key, one in mesh.data.items()}
            self._data.append(self._data[-1] if self._data and self._data[-1] == data else data)
            if before is None or not mesh.continues(before):
                starts.append((frame, len(mesh.points)))
                before, looks = mesh, ChangingLooks(mesh.attributes, mesh.connectivity)
                found.append(looks)
            else:
                but = looks.compare(mesh.attributes)
                self.changes.compare(frame, mesh.attributes, before.attributes, but)
            self.changes.note_lines(mesh.notices)
            self._kept.keep(frame, mesh.points)
        self.changes.note_lines(not_kept(self._not_joined, _UNEVEN_PARTS_NOTICE))
        firsts = [first for first, _ in starts]
        self._looks = {first: looks.fields() for first, looks in zip(firsts, found, strict=True)}
        for first, end in zip(firsts, [*firsts[1:], len(self.files)], strict=True):
            lost = [name for name in fields_of_frames(self._data[first:end])[1] if name not in self._not_joined]
            self.changes.note_lines(not_kept(lost, _UNEVEN_NOTICE))
        return starts


_UNEVEN_NOTICE = "not kept, because frames lack them or store them in other ways: {}"
"""Notice about data that cannot become a field."""

_UNEVEN_PARTS_NOTICE = "not kept in frames where some parts lack them or store them in other ways: {}"
"""Notice about data of several parts that cannot be joined."""


class FrameSequence(MeshSequence):
    """Frames of one connectivity, beginning at `first`, read on request."""

    def __init__(self, meshes: FrameMeshes, first: int, timing: Timing) -> None:
        self._meshes, self._first = meshes, first
        mesh, looks = meshes.mesh(first), meshes.looks(first)
        constant = tuple(one for one in mesh.attributes if one.name not in looks)
        self.times, self.fps, self.notices = timing
        item = MeshObject("mesh", mesh.connectivity, constant)
        self.objects = (item if mesh.normals is None else with_shared(item, self._poses(mesh)),)
        if mesh.normals is not None:
            turned = turned_in_pose(self.objects[0], (mesh.points, mesh.normals_of_corners))
            self.notices = (*self.notices, *turned_notices([turned]))
        self.metadata = {}
        self._keys = meshes.fields(first, self.times.size)
        self.fields = tuple(one for _, one in self._keys.values())

    def _poses(self, first: MeshFile) -> Iterator[Pose]:
        """Yield positions and normals of some frames, from the first one on."""
        later = (self._meshes.mesh(frame) for frame in spread(range(self._first, self._first + self.times.size)))
        with suppress(InputError):  # The error is raised when the frame is read.
            for mesh in chain([first], later):
                if mesh.continues(first):
                    yield mesh.points, mesh.normals_of_corners

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        rows = field.row_count(self.objects)
        values = np.empty((stop - start, rows, field.components), field.dtype)
        wanted = [key for key, _ in self._keys.values()]
        for frame in range(start, stop):
            stored = self._meshes.values(self._first + frame, self._keys[field.name][0], wanted, self.connectivity)
            if stored is not None and len(stored) != rows:
                raise damaged(
                    f"{field.name!r} has {len(stored)} rows for {rows} of domain {field.domain}; export it again",
                    path=self._meshes.files[self._first + frame][0],
                    frame=self._first + frame,
                )
            values[frame - start] = np.nan if stored is None else stored
        return values.reshape(field.shape(stop - start, self.objects))

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = np.empty((stop - start, self.vertex_count, 3), np.float32)
        for frame in range(start, stop):
            stored = self._meshes.points(self._first + frame, self.objects[0].connectivity)
            points[frame - start] = to_float32(stored)
        return points


def open_frames(path: Path, extension: str, read: Callable[[Path], MeshFile], fps: float | None) -> MeshSequence:
    """Open a file, a frame pattern or a folder; raises the errors of :func:`find_frames` and of reading the
    first frame.
    """
    files = find_frames(path, extension)
    meshes = FrameMeshes([[file] for file in files.paths], read)
    sequence = _sequence_of_meshes(meshes, timing_of_numbers(files.numbers, fps))
    sequence.list_contents = lambda: meshes.changes.contents(sequence.runs[0])
    return sequence


def sequence_of_files(
    files: Sequence[Sequence[Path]], timing: Timing | Callable[[], Timing], read: Callable[[Path], MeshFile]
) -> MeshSequence:
    """Return the sequence of the files of frames, in runs if connectivity changes; see :class:`FrameMeshes`.

    Every file is read once to find out whether connectivity and data change; its positions are kept if they fit in a
    block. If `timing` is a function, it is called after all files were read.
    """
    return _sequence_of_meshes(FrameMeshes(files, read), timing)


def _sequence_of_meshes(meshes: FrameMeshes, timing: Timing | Callable[[], Timing]) -> MeshSequence:
    starts = meshes.run_starts()
    times, fps, notices = timing() if callable(timing) else timing
    told = (*notices, *meshes.changes.notices(len(starts)))
    return runs_of_frames(starts, (times, fps, told), lambda first, own: FrameSequence(meshes, first, own))


def runs_of_frames(
    starts: Sequence[tuple[int, int]], timing: Timing, open_run: Callable[[int, Timing], MeshSequence]
) -> MeshSequence:
    """Return one run, or a sequence of several; `starts` lists first frame and vertex count of each, `open_run` opens
    the run that starts at a frame.

    Runs without vertices are left out, with a notice: a sequence cannot have frames without vertices.
    """
    times, fps, notices = timing
    ends = [*(first for first, _ in starts[1:]), times.size]
    kept = [(first, end, vertices) for (first, vertices), end in zip(starts, ends, strict=True) if vertices]
    frames = [end - first for first, end, _ in kept]
    if not kept:
        raise InputError("there are no vertices in any frame; check the file", code="no-vertices")
    if sum(frames) < times.size:
        lost = f"{times.size - sum(frames)} of {times.size} frames have no vertices and are left out"
        notices = (*notices, f"{lost}: the previous frame is shown in their place")
    first = open_run(kept[0][0], (times[kept[0][0] : kept[0][1]], fps, notices))
    if len(kept) == 1:
        return first

    def of(number: int) -> MeshSequence:
        begin, end, _ = kept[number]
        return open_run(begin, (times[begin:end], fps, ())) if number else first

    sequence = ChangingSequence(
        OpenedRuns(of, len(kept)),
        times=np.concatenate([times[begin:end] for begin, end, _ in kept]),
        frames=frames,
        vertices=[vertices for _, _, vertices in kept],
        fps=fps,
        metadata=first.metadata,
        notices=first.notices,
    )
    sequence.unsupported = first.unsupported
    return sequence


def _difference(mine: Connectivity, first: Connectivity) -> str:
    if mine.vertex_count != first.vertex_count:
        return f"there are {mine.vertex_count} vertices, but the first frame has {first.vertex_count}"
    if mine.face_count != first.face_count or mine.line_count != first.line_count:
        return (
            f"there are {mine.face_count} faces and {mine.line_count} lines, but the first frame has different numbers"
        )
    return "faces or lines join different vertices than in the first frame"


def join_cells(
    vertices: int, faces: Sequence[NDArray[np.integer]], lines: Sequence[NDArray[np.integer]]
) -> Connectivity:
    """Return the connectivity of cells: blocks of cells of one size, (cells, corners), or single cells, (corners,)."""
    joined = []
    for blocks in (faces, lines):
        rows = [np.atleast_2d(block) for block in blocks]
        joined.append(np.concatenate([np.zeros(0, np.int32), *(np.full(len(row), row.shape[1]) for row in rows)]))
        joined.append(np.concatenate([np.zeros(0, np.int64), *(row.reshape(-1) for row in rows)]))
    return Connectivity(vertices, *joined)


def strip_triangles(strip: NDArray[np.integer]) -> Int64Array:
    """Return the triangles (triangles, 3) int64 of a strip of vertices, every second one reversed."""
    steps = np.arange(max(0, strip.size - 2))
    odd = steps % 2
    corners: Int64Array = strip[np.stack([steps, steps + 1 + odd, steps + 2 - odd], axis=1)].astype(np.int64)
    return corners
