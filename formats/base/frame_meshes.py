"""Read meshes of one file per frame, in runs if connectivity changes, and write all of them or none."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged
from pdecodec.formats.base.attribute_roles import ID
from pdecodec.formats.base.frame_data import DataKey, StoredData, fields_of_frames, joined_data
from pdecodec.formats.base.frame_files import FOLDER_PADDING, find_frames, frames_there, is_frame_pattern, parse_pattern
from pdecodec.formats.base.frame_looks import ChangingLooks, is_same_attribute, looks_of_frame
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.times import Timing, timing_of_numbers
from pdecodec.mesh.arrays import Float32Array, Int64Array
from pdecodec.mesh.fields import Field, rows_of_domain
from pdecodec.mesh.rounding import to_float32
from pdecodec.mesh.runs import ChangingSequence, OpenedRuns
from pdecodec.mesh.sequence import (
    BLOCK_BYTES,
    Attribute,
    Connectivity,
    Content,
    MeshObject,
    MeshSequence,
    check_frame_range,
)
from pdecodec.system.whole_output import partial_folder, publish, write_errors

Positions = NDArray[Any]
"""Positions of a frame, of the number type that its file has."""


@dataclass(frozen=True)
class MeshFile:
    """The content of one file: positions (vertices, 3) as they are stored, what must be the same in every frame, and
    data that may change.
    """

    points: Positions
    connectivity: Connectivity
    attributes: tuple[Attribute, ...] = ()
    notices: tuple[str, ...] = ()
    data: Mapping[DataKey, StoredData] = field(default_factory=dict, compare=False)

    def continues(self, other: MeshFile) -> bool:
        """Return whether another mesh has the same faces and lines, and the same vertices if they have ids."""
        mine, theirs = (next((one.values for one in mesh.attributes if one.name == ID), None) for mesh in (self, other))
        if (mine is None) != (theirs is None):
            return False
        is_same = mine is None or theirs is None or np.array_equal(mine, theirs)
        return is_same and self.connectivity.same_as(other.connectivity)


class NotKept(str):
    """A line that names data of a file that is not kept, and the `names`, which the inventory lists as dropped."""

    __slots__ = ("names",)
    names: tuple[str, ...]


def is_about_loss(notice: str) -> bool:
    """Return whether a notice names data that is not kept."""
    return isinstance(notice, NotKept)


def not_kept(names: Iterable[str], line: str = "not kept: {}") -> tuple[str, ...]:
    """Return the line that names data of a file that is not kept; nothing if there is none."""
    found = tuple(dict.fromkeys(names))
    if not found:
        return ()
    told = NotKept(line.format(", ".join(found)))
    told.names = found
    return (told,)


def joined_meshes(parts: list[MeshFile]) -> MeshFile:
    """Join several meshes, their points one after the other; attributes, which belong to single parts, are dropped."""
    if len(parts) == 1:
        return parts[0]
    firsts = np.cumsum([0, *(len(part.points) for part in parts)])
    shared = [part.connectivity for part in parts]
    connectivity = Connectivity(
        int(firsts[-1]),
        np.concatenate([one.face_counts for one in shared]),
        np.concatenate([one.face_indices + first for one, first in zip(shared, firsts, strict=False)]),
        np.concatenate([one.line_counts for one in shared]),
        np.concatenate([one.line_indices + first for one, first in zip(shared, firsts, strict=False)]),
    )
    names = dict.fromkeys(one.name for part in parts for one in part.attributes)
    notices = dict.fromkeys(notice for part in parts for notice in part.notices)
    lost = (f"not kept, because the file has several parts: {', '.join(names)}",) if names else ()
    points = np.concatenate([part.points for part in parts])
    data = joined_data([part.data for part in parts if len(part.points)] or [parts[0].data])
    return MeshFile(points, connectivity, (), (*notices, *lost), data)


_KINDS = {
    "color": "colours",
    "uv": "UVs",
    "normal_group": "hard edges",
    "group": "groups",
    "material": "materials",
    "smoothing": "smoothing groups",
}
"""Words for the roles of attributes."""


def kind_of(data: Attribute | Field) -> str:
    """Return the words for the role, domain and name of data: "vertex colours", "UVs 'map2'", "face area"."""
    role, _, name = data.name.partition(":")
    if role not in _KINDS and isinstance(data, Field):
        return data.name if data.domain == "vertex" else f"{data.domain} {data.name}"
    if role not in _KINDS:
        return f"attribute {data.name!r}"
    domain = f"{data.domain} " if role == "color" else ""
    return f"{domain}{_KINDS[role]}{f' {name!r}' if name and name != data.domain else ''}"


class FrameChanges:
    """Differences of frames from the first frame of their run, and all notices about their files."""

    def __init__(self) -> None:
        self._frames: dict[str, int] = {}
        self._absent: set[str] = set()
        self._notices: dict[str, str] = {}

    def note(self, frame: int, kind: str, *, is_in_first: bool) -> None:
        """Note that data of a kind differ in a frame, and whether the first frame has any."""
        if kind not in self._frames:
            self._frames[kind] = frame
            if not is_in_first:
                self._absent.add(kind)

    def note_lines(self, notices: Iterable[str]) -> None:
        """Note lines about a file; of lines that differ only in numbers the first one is kept."""
        for notice in notices:
            self._notices.setdefault(re.sub(r"\d+", "#", notice), notice)

    def compare(self, frame: int, mesh: MeshFile, first: MeshFile, but: Collection[str] = ()) -> None:
        """Compare the attributes of a frame, `but` those of some names, with those of the first frame of its run."""
        mine, others = ({kind_of(one): one for one in each.attributes if one.name not in but} for each in (first, mesh))
        for kind in {**mine, **others}.keys() - self._frames.keys():
            if not is_same_attribute(mine.get(kind), others.get(kind)):
                self.note(frame, kind, is_in_first=kind in mine)

    def notices(self, runs: int) -> tuple[str, ...]:
        """Return notices about the files, and about what changes from frame to frame; `runs` is the number of runs."""
        kept = "the first frame's are kept" if runs < 2 else "those of the first frame of each run are kept"
        changes = [
            f"{kind} are not in the first frame (first at frame {frame}): they are not kept"
            if kind in self._absent
            else f"{kind} change from frame to frame (first at frame {frame}): {kept}"
            for kind, frame in sorted(self._frames.items(), key=lambda item: (item[1], item[0]))
        ]
        return (*self._notices.values(), *changes)

    def contents(self, run: MeshSequence) -> tuple[Content, ...]:
        """List the content of files: what a run of frames keeps, and data of any frame that are not kept."""
        lost = [name for line in self._notices.values() if isinstance(line, NotKept) for name in line.names]
        lost += sorted(self._absent)
        lost += [f"changes of {kind}" for kind in sorted(self._frames.keys() - self._absent)]
        return (
            *(one for item in run.objects for one in kept_of(item)),
            *(Content(f"/{kind}", kind, "coded") for kind in map(kind_of, run.fields)),
            *(Content(f"/{kind}", kind, "dropped") for kind in dict.fromkeys(lost)),
        )


def kept_of(item: MeshObject) -> Iterator[Content]:
    """List positions, faces, lines, and attributes of an object, labels of attributes one by one."""
    faces, lines = item.connectivity.face_count, item.connectivity.line_count
    for kind in ["positions", *["faces"] * bool(faces), *["lines"] * bool(lines)]:
        yield Content(f"/{item.name}/{kind}", kind, "coded")
    for attribute in item.attributes:
        if attribute.name == "object":
            continue  # the reader lists the names of objects
        kind = kind_of(attribute)
        for label in attribute.labels or ("",):
            yield Content(f"/{item.name}/{kind}/{label}".rstrip("/"), kind, "coded")


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
        self._values: dict[int, Mapping[DataKey, NDArray[Any]]] = {}
        self._values_room = BLOCK_BYTES
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
        """Return the fields of the frames of a run, by name, and where their values are."""
        return {**self.looks(first), **fields_of_frames(self._data[first : first + frames])[0]}

    def looks(self, first: int) -> dict[str, tuple[DataKey, Field]]:
        """Return UVs and colours that change in the run that begins with a frame, as :meth:`fields` does."""
        return self._looks.get(first, {})

    def values(self, frame: int, key: DataKey, connectivity: Connectivity) -> NDArray[Any] | None:
        """Return data of a frame (rows, components), None if it lacks them.

        All data of a frame are kept if they still fit in a block, so that each field does not read the file again;
        else only the data asked for are decoded.
        """
        if frame in self._values:
            return self._values[frame].get(key)
        mesh = self.mesh(frame)
        self._check(frame, mesh, connectivity)
        stored = {**looks_of_frame(mesh.attributes, mesh.connectivity), **mesh.data}
        if key not in stored:
            return None
        size = sum(
            rows_of_domain(MeshObject("", connectivity), one[0]) * found.row_bytes for one, found in stored.items()
        )
        if size > self._values_room:
            return stored[key].read()
        self._values[frame] = {key: one.read() for key, one in stored.items()}
        self._values_room -= sum(array.nbytes for array in self._values[frame].values())
        return self._values[frame][key]

    def run_starts(self) -> list[tuple[int, int]]:
        """Return the first frame and vertex count of each run of frames that have the same faces, lines and ids.

        Only a first frame that cannot be read fails here; other frames fail when they are asked for.
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
                self.changes.compare(frame, mesh, before, looks.compare(mesh.attributes))
            self.changes.note_lines(mesh.notices)
            self._kept.keep(frame, mesh.points)
        self.changes.note_lines(not_kept(self._not_joined, _UNEVEN_PARTS))
        firsts = [first for first, _ in starts]
        self._looks = {first: looks.fields() for first, looks in zip(firsts, found, strict=True)}
        for first, end in zip(firsts, [*firsts[1:], len(self.files)], strict=True):
            lost = [name for name in fields_of_frames(self._data[first:end])[1] if name not in self._not_joined]
            self.changes.note_lines(not_kept(lost, _UNEVEN))
        return starts


_UNEVEN = "not kept, because frames lack them or store them in other ways: {}"
"""Line that names data that cannot be a field."""

_UNEVEN_PARTS = "not kept in frames where some parts lack them or store them in other ways: {}"
"""Line that names data that cannot be joined."""


class KeptPositions(dict[int, Positions]):
    """Positions of frames that were read to compare them, as many as fit in a block."""

    room = BLOCK_BYTES

    def keep(self, frame: int, points: Positions) -> None:
        if points.nbytes <= self.room:
            self.room -= points.nbytes
            self[frame] = points


class FrameSequence(MeshSequence):
    """Frames of one connectivity, beginning at `first`, that are read when they are asked for."""

    def __init__(self, meshes: FrameMeshes, first: int, timing: Timing) -> None:
        self._meshes, self._first = meshes, first
        mesh, looks = meshes.mesh(first), meshes.looks(first)
        constant = tuple(one for one in mesh.attributes if one.name not in looks)
        self.objects = (MeshObject("mesh", mesh.connectivity, constant),)
        self.times, self.fps, self.notices = timing
        self.metadata = {}
        self._keys = meshes.fields(first, self.times.size)
        self.fields = tuple(one for _, one in self._keys.values())

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        rows = field.row_count(self.objects)
        values = np.empty((stop - start, rows, field.components), field.dtype)
        for frame in range(start, stop):
            stored = self._meshes.values(self._first + frame, self._keys[field.name][0], self.connectivity)
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
    """Open a file, a frame pattern or a folder; errors are those of :func:`find_frames` and of reading the
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

    Every file is read once to find out whether it and other data change; positions are kept while they fit in a
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
    """Return one run, or a sequence of several: `starts` has first frame and vertex count; `open_run` opens by first
    frame.

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
        notices = (*notices, f"{lost}: until the next frame the previous one stays")
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
        return f"there are {mine.face_count} faces and {mine.line_count} lines, but the first frame has others"
    return "faces or lines join other vertices than in the first frame"


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


FrameBytes = Callable[[Float32Array, int], Iterable[bytes]]
"""Returns the bytes of a file from positions (vertices, 3) and the index of the frame in its run."""


def write_frames(
    sequence: MeshSequence,
    output: Output,
    what: str,
    frame_bytes: Callable[[MeshSequence, int], FrameBytes],
    *,
    new_folder: bool = False,
    index: tuple[Path, Callable[[Sequence[Path]], bytes]] | None = None,
) -> list[Path]:
    """Write a file for each frame, all of them or none; return their paths.

    The frames are written to a hidden folder next to their place, and moved after the last one is written; a run
    that is killed while it moves them is finished by the next. When frames are replaced, those without a new frame
    are removed.

    Parameters
    ----------
    sequence : MeshSequence
    output : Output
        A pattern, ``name.####.ply``; for a single frame also a plain name.
    what : str
        The format.
    frame_bytes : callable
        Takes a run of the sequence and its first frame, and returns the function that makes the parts of its files.
    new_folder : bool
        Whether the pattern's folder is new, and appears at once when everything is written.
    index : tuple of a path and a callable, optional
        A file that is published together with the frames, and the function that makes its bytes from their paths.

    Raises
    ------
    InputError
        If the output exists or is not writable, or several frames are to go to one file.
    """
    pattern = output.path
    if not is_frame_pattern(pattern):
        if sequence.frame_count > 1:
            name = f"{pattern.stem}.{FOLDER_PADDING}{pattern.suffix}"
            raise InputError(
                f"{sequence.frame_count} frames do not fit in one {what} file; name it {name}",
                code="too-large",
                path=pattern,
            )
        with output.whole_file() as partial, partial.open("wb") as file:
            file.writelines(frame_bytes(sequence.runs[0], 0)(sequence.read_frames(0, 1)[0], 0))
        return [pattern]
    old = frames_there(pattern)
    if old and not output.overwrite:
        raise InputError(
            f"frames exist already ({old[0].name})",
            code="output-exists",
            path=pattern,
            setting="overwrite",
            purpose="to replace them",
        )
    parsed = parse_pattern(pattern)
    # Number frames by their times if these are consecutive, else count up from the first.
    numbers = np.rint(sequence.times * output.rate)
    if not (np.diff(numbers) == 1).all():
        numbers = numbers[0] + np.arange(sequence.frame_count)
    paths = [pattern.with_name(Path(parsed.frame(int(number))).name) for number in numbers]
    place = pattern.parent if new_folder else pattern
    with partial_folder(place) as partial, write_errors(place):
        for run, first, start, block in output.blocks_of_runs(sequence, what):
            if start == first:
                bytes_of = frame_bytes(run, first)
            for frame, points in enumerate(block, start):
                with (partial / paths[frame].name).open("wb") as file:
                    file.writelines(bytes_of(points, frame - first))
        if new_folder:
            os.replace(partial, place)
            return paths
        names = [path.name for path in paths]
        if index is not None:
            (partial / index[0].name).write_bytes(index[1](paths))
            names.append(index[0].name)
        gone = [path.name for path in set(old) - set(paths)]
        publish(partial, names, overwrite=output.overwrite, remove=gone)
    return paths
