"""OBJ sequences: one Wavefront OBJ file a frame, read in parallel.

Frames of the same faces, lines and UV indices are a run. Names, UVs, colours and hard edges are those of its first
frame; of every other one positions are read, and names may differ, as exporters number them.

Names of faces are states in OBJ: each holds until the next statement of its kind. Here they become one integer
a face. Names that mean "none" in OBJ (``g default``, a bare ``usemtl``, ``s off``) are -1, and 0 for ``s``.

OBJ has no time. Our writer starts each file with a comment that says when it is, so that irregular times and the
frame rate come back; other readers skip it.
"""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from pdecodec._core import ObjScan, ObjStructure
from pdecodec.errors import InputError
from pdecodec.formats.base.frame_files import FrameFiles, find_frames
from pdecodec.formats.base.frame_meshes import KeptPositions, runs_of_frames
from pdecodec.formats.base.normals import normal_group, read_normal_group
from pdecodec.formats.base.registry import read_errors
from pdecodec.formats.base.scene_writing import DEFAULT_NAME
from pdecodec.formats.base.times import Timing, timing_of_numbers
from pdecodec.formats.obj.text import NoVerticesError, ObjText, is_far, read_text, rounding_of_text, scan
from pdecodec.mesh.arrays import Float32Array, Int32Array
from pdecodec.mesh.rounding import is_rounding_noticed, note_rounding
from pdecodec.mesh.sequence import Attribute, Connectivity, MeshObject, MeshSequence, check_frame_range, check_times

MOST_THREADS = 8
"""Threads that read frames; beyond it the disk and the memory bus are the limit."""

PARALLEL_BYTES = 256 * 1024
"""Frames of shorter text are read by one thread: handing them out would cost more than it saves."""

LONGEST_COMMENT = 128
"""Bytes read from the start of each file to find the comment that says its time."""

_COMMENT = re.compile(rb"# time ([-+.\deE]{1,30}) s at ([-+.\deE]{1,30}) frames per second\r?\n")

GEOMETRY_NOT_READ = frozenset({"curv", "curv2", "surf", "fo", "bzp", "bsp", "cdc", "cdp", "res", "call", "csh"})
"""Statements that carry geometry: a file without them would be another model, so they are refused."""

_STATEMENT = re.compile(r"[A-Za-z_]\w*", re.ASCII)


def open_obj(path: Path, *, fps: float | None = None, threads: int | None = None) -> MeshSequence:
    """Open an OBJ file, frame pattern or folder: every frame is read once, to learn where faces change.

    Parameters
    ----------
    path : pathlib.Path
        See :func:`pdecodec.formats.base.frame_files.find_frames`.
    fps : float or None
        Frames per second; None takes what our writer noted, else 24 with a notice.
    threads : int, optional
        How many read at a time. The result does not depend on it. Default: one a processor, at most eight;
        one where frames are small.

    Raises
    ------
    InputError
        If frames are missing, or the first one cannot be used.
    """
    files = find_frames(path, ".obj")
    timing = _timing(files, fps)
    frames = _ObjFrames(files.paths, threads)
    return runs_of_frames(frames.run_starts(), timing, lambda first, own: ObjSequence(frames, first, own))


class _ObjFrames:
    """Files of frames, how many are read at a time, and positions that were read to compare them."""

    def __init__(self, paths: Sequence[Path], threads: int | None) -> None:
        self.paths, self._kept = paths, KeptPositions()
        with read_errors(paths[0]):
            is_large = paths[0].stat().st_size >= PARALLEL_BYTES
        self.threads = threads or (min(MOST_THREADS, os.cpu_count() or 1) if is_large else 1)

    def run_starts(self) -> list[tuple[int, int]]:
        """The first frame of each run, and its vertices; what cannot be read is told of when it is asked for."""
        starts: list[tuple[int, int]] = []
        structure: _Structure | None = None
        frame, at_once = 0, 1
        with ThreadPoolExecutor(self.threads) as pool:
            while frame < len(self.paths):
                if structure is None:
                    text = read_text(self.paths[frame], frame)
                    try:
                        structure, at_once = _Structure(text, scan(text)), 1
                        starts.append((frame, structure.vertices))
                        self._kept.keep(frame, structure.positions)
                    except NoVerticesError:
                        if len(self.paths) == 1:
                            raise
                        starts.append((frame, 0))
                    frame += 1
                    continue
                batch = range(frame, min(frame + at_once, len(self.paths)))
                for index, points in zip(batch, pool.map(partial(self._compared, structure), batch), strict=True):
                    if points is None:
                        structure = None
                        break
                    self._kept.keep(index, points)
                    frame += 1
                at_once = min(2 * at_once, 2 * self.threads)
        return starts

    def _compared(self, structure: _Structure, frame: int) -> Float32Array | None:
        """Positions of a frame, none where they cannot be read; None where its faces are others."""
        points = np.empty((structure.vertices, 3), np.float32)
        try:
            structure.read_positions(self.paths[frame], frame, points)
        except (_ChangedError, NoVerticesError):
            return None
        except InputError:
            return points[:0]
        return points

    def read(self, structure: _Structure, frame: int, points: Float32Array) -> None:
        """Read a frame's positions into `points`, (vertices, 3) float32; errors as of `structure`."""
        kept = self._kept.get(frame)
        if kept is None or len(kept) != len(points):
            structure.read_positions(self.paths[frame], frame, points)
        else:
            points[:] = kept

    def note_rounding(self, frame: int, points: Float32Array) -> None:
        """Note how far positions (vertices, 3) of a frame are from its text, which is read again."""
        if is_far(points):
            note_rounding(rounding_of_text(read_text(self.paths[frame], frame), points))


class ObjSequence(MeshSequence):
    """Frames of one connectivity, from one on, that are read when they are asked for."""

    def __init__(self, frames: _ObjFrames, first: int, timing: Timing) -> None:
        self._frames, self._first = frames, first
        text = read_text(frames.paths[first], first)
        scanned = scan(text)
        model = _Model(text, scanned)
        self.times, self.fps, notices = timing
        self.objects, self.metadata = model.objects, model.metadata
        self.notices = notices + model.notices
        self._structure = _Structure(text, scanned)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = np.empty((stop - start, self.vertex_count, 3), np.float32)

        def read(frame: int) -> None:
            self._frames.read(self._structure, self._first + frame, points[frame - start])

        with ThreadPoolExecutor(max_workers=min(self._frames.threads, max(1, stop - start))) as pool:
            # map gives results in order, so the error raised is that of the first bad frame
            for _ in pool.map(read, range(start, stop)):
                pass
        if is_rounding_noticed():
            for frame, found in enumerate(points, self._first + start):
                self._frames.note_rounding(frame, found)
        return points


class _ChangedError(InputError):
    """A frame has other faces than the one before."""


class _Structure:
    """What must not change from frame to frame, as bytes to compare quickly and as indices to compare well."""

    def __init__(self, text: ObjText, first: ObjScan) -> None:
        self._lines, self._first = ObjStructure(text.data), first
        self.vertices: int = first.vertex_count

    @property
    def positions(self) -> Float32Array:
        """Of the first frame, (vertices, 3)."""
        found: Float32Array = self._first.positions
        return found

    def read_positions(self, path: Path, frame: int, points: Float32Array) -> None:
        """Read a frame's positions into `points`, (vertices, 3) float32.

        Raises
        ------
        InputError
            If the file is unusable or its connectivity is another one.
        """
        text = read_text(path, frame)
        unread = self._lines.read_positions(text.data, points)
        if unread is not None:
            text.read_rest(unread, points)
            return
        # A frame that is written differently: find out whether it is different.
        other = scan(text)
        _Model(text, other)  # refuses statements that carry geometry
        difference = self._difference(other)
        if difference:
            raise _ChangedError(f"{difference}; the file changed while it was read", path=path, frame=frame)
        points[:] = other.positions

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
    """Frame numbers over `fps`; without it what the files' own comments say, where all of them say it."""
    if fps is None:
        told = [_read_comment(path) for path in files.paths]
        known = [item for item in told if item is not None]
        if len(known) == len(told):
            return *check_times(len(known), [time for time, _ in known], known[0][1]), ()
    return timing_of_numbers(files.numbers, fps)


def _read_comment(path: Path) -> tuple[float, float] | None:
    with read_errors(path), path.open("rb") as file:
        match = _COMMENT.match(file.read(LONGEST_COMMENT))
    try:
        time, rate = (math.nan, math.nan) if match is None else (float(match[1]), float(match[2]))
    except ValueError:
        return None
    return (time, rate) if math.isfinite(time) and 0 < rate < math.inf else None


@dataclass
class _State:
    """One kind of name: its labels, and from which element on each holds (-1: none)."""

    labels: dict[str, int] = field(default_factory=dict)
    starts: list[int] = field(default_factory=lambda: [0])
    values: list[int] = field(default_factory=lambda: [-1])

    def change(self, element: int, label: str | None) -> None:
        self.starts.append(element)
        self.values.append(-1 if label is None else self.labels.setdefault(label, len(self.labels)))

    def per_element(self, elements: int) -> Int32Array:
        return np.repeat(np.asarray(self.values, np.int32), np.diff([*self.starts, elements]))


@dataclass(frozen=True)
class _Part:
    """A range of vertices and elements under one ``o``."""

    name: str | None
    vertices: tuple[int, int]
    elements: tuple[int, int]


def _as_text(name: bytes) -> str:
    try:
        return name.decode("utf-8")
    except UnicodeDecodeError:
        return name.decode("latin-1")  # what older exporters write; every byte is a letter of it


def _statement(text: ObjText, offset: int) -> tuple[str, str]:
    """Word and argument of a statement, blanks of the argument single."""
    word, *words = [_as_text(token) for token in text.line(offset).split()]
    if not _STATEMENT.fullmatch(word):
        raise text.error(offset, f"{text.token(offset)!r} is not an OBJ statement; check the file")
    if word in GEOMETRY_NOT_READ:
        raise text.error(offset, f"curves and surfaces ({word}) are not read; export polygons instead")
    return word, " ".join(words)


def _smoothing_group(text: ObjText, offset: int, argument: str) -> str | None:
    if argument in ("", "off"):
        return None
    if not re.fullmatch(r"\d{1,9}", argument, re.ASCII):
        raise text.error(offset, f"a smoothing group is a number or off, not {argument[:40]!r}")
    return None if int(argument) == 0 else argument


class _Model:
    """Objects, attributes, metadata and notices of a file.

    Each ``o`` becomes an object where its elements use only vertices declared under it; otherwise the file is
    one object and the names are a face attribute ``"object"``.

    Raises
    ------
    InputError
        With file and line, for statements that carry geometry we do not read, or that are none at all.
    """

    def __init__(self, text: ObjText, scan: ObjScan) -> None:
        self._scan = scan
        states = {"group": _State(), "material": _State(), "smoothing": _State(), "object": _State()}
        marks: list[tuple[str | None, int, int]] = [(None, 0, 0)]
        self.metadata: dict[str, str] = {}
        left_out: dict[str, None] = {}
        for offset, vertices, elements in scan.others.tolist():
            word, argument = _statement(text, offset)
            match word:
                case "o":
                    states["object"].change(elements, argument or None)
                    marks.append((argument or None, vertices, elements))
                case "g":
                    states["group"].change(elements, argument if argument not in ("", "default") else None)
                case "usemtl":
                    states["material"].change(elements, argument or None)
                case "s":
                    states["smoothing"].change(elements, _smoothing_group(text, offset, argument))
                case "mtllib":
                    self.metadata["mtllib"] = argument
                case _:
                    left_out[word] = None
        marks.append((None, scan.vertex_count, scan.element_sizes.size))
        self._states = {name: state.per_element(scan.element_sizes.size) for name, state in states.items()}
        self._labels = {name: tuple(state.labels) for name, state in states.items()}
        self._corner_starts = np.concatenate([[0], np.cumsum(scan.element_sizes, dtype=np.int64)])
        self._is_face = scan.is_face.astype(bool)
        parts = [
            _Part(name, (vertex, vertex_end), (element, element_end))
            for (name, vertex, element), (_, vertex_end, element_end) in pairwise(marks)
            if vertex < vertex_end or element < element_end
        ]
        whole = (0, scan.vertex_sizes.size)
        if self._are_separate(parts):
            self.objects = tuple(self._build(part, alone=len(parts) == 1) for part in parts)
        else:
            self.objects = (self._build_whole(parts, whole),)
        # A part of every vertex and nothing else names the whole, as our writer leaves it.
        named = [part for part in parts if part.elements[0] < part.elements[1] or part.vertices != whole]
        counts = Counter(part.name or DEFAULT_NAME for part in named)
        several = [repr(name) for name, count in counts.items() if count > 1]
        merged = (f"several objects are called {', '.join(several)}: the file is one object",) if several else ()
        self.notices = merged + self._notices(left_out)

    def _are_separate(self, parts: list[_Part]) -> bool:
        names = [part.name or DEFAULT_NAME for part in parts]
        if len(set(names)) < len(names) or any(part.vertices[0] == part.vertices[1] for part in parts):
            return False
        for part in parts:
            used = self._corners(part)[:, 0]
            if used.size and not (part.vertices[0] <= used.min() and used.max() < part.vertices[1]):
                return False
        return True

    def _build_whole(self, parts: list[_Part], vertices: tuple[int, int]) -> MeshObject:
        """The file as one object, named by the part that declares every vertex or by the only name there is."""
        name = next((part.name for part in parts if part.vertices == vertices), None)
        names = np.unique(self._states["object"])
        only_name = names.size == 1 and names[0] >= 0 and name is None
        if only_name:
            name = self._labels["object"][names[0]]
        part = _Part(name, vertices, (0, self._scan.element_sizes.size))
        return self._build(part, alone=True, keep_names=not only_name)

    def _build(self, part: _Part, *, alone: bool, keep_names: bool = False) -> MeshObject:
        start, stop = part.elements
        sizes = self._scan.element_sizes[start:stop]
        is_face = self._is_face[start:stop]
        on_face = np.repeat(is_face, sizes)
        corners = self._corners(part)
        vertices = corners[:, 0] - np.int32(part.vertices[0])
        connectivity = Connectivity(
            part.vertices[1] - part.vertices[0],
            face_counts=sizes[is_face],
            face_indices=vertices[on_face],
            line_counts=sizes[~is_face],
            line_indices=vertices[~on_face],
        )
        attributes = [
            self._uv(corners[on_face, 1], compact=not alone),
            self._color(part),
            self._normals(corners[on_face, 2], connectivity),
            *(
                self._names(name, self._states[name][start:stop][is_face])
                for name in ("object", "group", "material", "smoothing")
                if name != "object" or keep_names
            ),
        ]
        return MeshObject(part.name or DEFAULT_NAME, connectivity, tuple(item for item in attributes if item))

    def _corners(self, part: _Part) -> Int32Array:
        start, stop = self._corner_starts[list(part.elements)]
        return self._scan.corners[start:stop]

    def _uv(self, indices: Int32Array, *, compact: bool) -> Attribute | None:
        used = np.unique(indices[indices >= 0])
        if used.size == 0:
            return None
        values = self._scan.textures[:, : max(2, self._scan.texture_size)]
        if compact:
            indices = np.where(indices >= 0, np.searchsorted(used, indices), -1)
            values = values[used]
        return Attribute("uv", "corner", values.copy(), indices=np.ascontiguousarray(indices, np.int32))

    def _color(self, part: _Part) -> Attribute | None:
        sizes = self._scan.vertex_sizes[slice(*part.vertices)]
        colored = sizes >= 6
        if not colored.any():
            return None
        width = 4 if (sizes == 7).any() else 3
        values = self._scan.vertex_extras[slice(*part.vertices), :width].copy()
        if width == 4:
            values[sizes == 6, 3] = 1.0
        if colored.all():
            return Attribute("color", "vertex", values)
        indices = np.where(colored, np.cumsum(colored) - 1, -1).astype(np.int32)
        return Attribute("color", "vertex", values[colored], indices=indices)

    def _normals(self, indices: Int32Array, connectivity: Connectivity) -> Attribute | None:
        normals = self._scan.normals
        if indices.max(initial=-1) < 0:
            return None
        first, last = int(indices.min()), int(indices.max())
        if first < 0 or last >= len(normals):
            # Normals that are not there still say which corners share one.
            return normal_group(connectivity, indices)
        order = np.arange(indices.size)
        return read_normal_group(connectivity, "corner", normals[first : last + 1], indices - first, order)

    def _names(self, name: str, of_faces: Int32Array) -> Attribute | None:
        used = np.unique(of_faces[of_faces >= 0])
        if used.size == 0:
            return None
        labels = self._labels[name]
        if name == "smoothing":
            numbers = np.asarray([int(label) for label in labels], np.int32)
            return Attribute(name, "face", np.where(of_faces >= 0, numbers[of_faces], np.int32(0)))
        values = np.where(of_faces >= 0, np.searchsorted(used, of_faces), -1).astype(np.int32)
        return Attribute(name, "face", values, labels=tuple(labels[index] for index in used))

    def _notices(self, left_out: Iterable[str]) -> tuple[str, ...]:
        scan = self._scan
        lines = ~self._is_face
        notices = []
        if (scan.vertex_sizes == 4).any():
            notices.append("the weight of vertices (the fourth number of v) is not kept")
        if (scan.corners[np.repeat(lines, scan.element_sizes), 1] >= 0).any():
            notices.append("texture vertices of lines (l v/vt) are not kept")
        if any((self._states[name][lines] >= 0).any() for name in ("group", "material")):
            notices.append("groups and materials of lines and points are not kept")
        if left_out:
            notices.append(f"statements not kept: {', '.join(left_out)}")
        return tuple(notices)
