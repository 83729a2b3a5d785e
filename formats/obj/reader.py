"""OBJ sequences: one Wavefront OBJ file a frame, read in parallel.

Frames of the same faces, lines and UV indices are a run. Names, UVs, colours and hard edges are those of its first
frame; of every other one positions are read, and what else differs is told once.

OBJ has no time. Our writer starts each file with a comment that says when it is, so that irregular times and the
frame rate come back; other readers skip it.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from pdecodec._core import ObjScan, ObjStructure
from pdecodec.errors import InputError
from pdecodec.formats.base.frame_files import FrameFiles, find_frames
from pdecodec.formats.base.frame_meshes import FrameChanges, KeptPositions, runs_of_frames
from pdecodec.formats.base.registry import read_errors
from pdecodec.formats.base.times import Timing, timing_of_numbers
from pdecodec.formats.obj.model import ObjModel
from pdecodec.formats.obj.text import NoVerticesError, ObjText, is_far, read_text, rounding_of_text, scan
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.rounding import is_rounding_noticed, note_rounding
from pdecodec.mesh.sequence import MeshSequence, check_frame_range
from pdecodec.mesh.times import check_times

MOST_THREADS = 8
"""Threads that read frames; beyond it the disk and the memory bus are the limit."""


PARALLEL_BYTES = 256 * 1024
"""Frames of shorter text are read by one thread: handing them out would cost more than it saves."""


LONGEST_COMMENT = 128
"""Bytes read from the start of each file to find the comment that says its time."""


_COMMENT = re.compile(rb"# time ([-+.\deE]{1,30}) s at ([-+.\deE]{1,30}) frames per second\r?\n")


_VERTEX_ENDS, _TEXTURES, _LIBRARIES = 1, 2, 4
"""Data that the core compares, as bits: what follows positions, texture vertices, mtllib."""


_BITS = {"vertex colours": _VERTEX_ENDS, "UVs": _TEXTURES, "names of mtllib": _LIBRARIES}


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
    starts, (times, rate, notices) = frames.run_starts(), timing
    told = (*notices, *frames.changes.notices(len(starts)))
    return runs_of_frames(starts, (times, rate, told), lambda first, own: ObjSequence(frames, first, own))


class _ObjFrames:
    """Files of frames, how many are read at a time, and positions that were read to compare them."""

    def __init__(self, paths: Sequence[Path], threads: int | None) -> None:
        self.paths, self._kept, self.changes = paths, KeptPositions(), FrameChanges()
        self._opened: dict[int, _Structure] = {}
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
                compared = pool.map(partial(self._compared, structure), batch)
                for index, (points, model) in zip(batch, compared, strict=True):
                    if points is None:
                        structure = None
                        break
                    if model is not None:
                        structure.note_changes(model, index, self.changes)
                    self._kept.keep(index, points)
                    frame += 1
                at_once = min(2 * at_once, 2 * self.threads)
        return starts

    def structure(self, first: int) -> _Structure:
        """What must not change in the run that begins with a frame; that of the first run is kept."""
        return self._opened.get(first) or _Structure(read_text(self.paths[first], first))

    def _compared(self, structure: _Structure, frame: int) -> tuple[Float32Array | None, ObjModel | None]:
        """Positions of a frame, none where they cannot be read, and its model where other data may have changed.

        None for positions where its faces are others.
        """
        points = np.empty((structure.vertices, 3), np.float32)
        try:
            return points, structure.read_positions(self.paths[frame], frame, points, compare=True)
        except (_ChangedError, NoVerticesError):
            return None, None
        except InputError:
            return points[:0], None

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
        self._structure = frames.structure(first)
        model = self._structure.model
        self.times, self.fps, self.notices = timing
        self.objects, self.metadata = model.objects, model.metadata

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

    def __init__(self, text: ObjText) -> None:
        self._lines, self._first = ObjStructure(text.data), scan(text)
        self.vertices: int = self._first.vertex_count
        self.model = ObjModel(text, self._first)
        self._unchanged = _VERTEX_ENDS | _TEXTURES | _LIBRARIES

    @property
    def positions(self) -> Float32Array:
        """Of the first frame, (vertices, 3)."""
        found: Float32Array = self._first.positions
        return found

    def note_changes(self, model: ObjModel, frame: int, changes: FrameChanges) -> None:
        """Note what else differs in a frame; data that are known to change are not compared again."""
        changes.note_lines(model.notices)
        for kind, is_in_first in self.model.changes_to(model):
            changes.note(frame, kind, is_in_first=is_in_first)
            self._unchanged &= ~_BITS.get(kind, 0)

    def read_positions(self, path: Path, frame: int, points: Float32Array, *, compare: bool = False) -> ObjModel | None:
        """Read a frame's positions into `points`, (vertices, 3) float32.

        Returns
        -------
        ObjModel or None
            Of the frame, where its other data may have changed and `compare` asks for it.

        Raises
        ------
        InputError
            If the file is unusable or its connectivity is another one.
        """
        text = read_text(path, frame)
        found = self._lines.read_positions(text.data, points)
        if found is not None:
            unread, changed = found
            text.read_rest(unread, points)
            return ObjModel(text, scan(text)) if compare and changed & self._unchanged else None
        # A frame that is written differently: find out whether it is different.
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
