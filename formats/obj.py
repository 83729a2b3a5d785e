"""OBJ sequences: one Wavefront OBJ file a frame, read in parallel and only as far as asked for.

Connectivity, names, UVs and colours are those of the first frame. In every other frame the positions are read,
and faces, lines and UV indices must be the same; names may differ, as exporters number them.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from pdecodec.errors import InputError
from pdecodec.formats.frame_files import find_frames
from pdecodec.formats.obj_kernels import copy_structure, find_positions
from pdecodec.formats.obj_objects import build_model
from pdecodec.formats.obj_scan import ObjScan, scan
from pdecodec.formats.obj_text import ObjText, read_text
from pdecodec.formats.obj_time import times_of_frames
from pdecodec.sequence import Float32Array, MeshSequence, check_frame_range

MOST_THREADS = 8
"""Threads that read frames; beyond it the disk and the memory bus are the limit."""


PARALLEL_BYTES = 256 * 1024
"""Frames of shorter text are read by one thread: handing them out would cost more than it saves."""


def open_obj(path: Path, *, fps: float | None) -> MeshSequence:
    """Open an OBJ file, frame pattern or folder.

    Parameters
    ----------
    path : pathlib.Path
        See :func:`pdecodec.formats.frame_files.find_frames`.
    fps : float or None
        Frames per second; None takes what our writer noted, else 24 with a notice.

    Raises
    ------
    InputError
        If frames are missing, or the first one cannot be used.
    """
    return ObjSequence(path, fps=fps)


class ObjSequence(MeshSequence):
    """A sequence of OBJ files; frames are read, and compared with the first, when they are asked for.

    Parameters
    ----------
    path : pathlib.Path
    fps : float, optional
    threads : int, optional
        How many read at a time. The result does not depend on it. Default: one a processor, at most eight;
        one where frames are small.
    """

    def __init__(self, path: Path, *, fps: float | None = None, threads: int | None = None) -> None:
        files = find_frames(path, ".obj")
        self._paths = files.paths
        self.times, self.fps, time_notices = times_of_frames(files, fps)
        text = read_text(self._paths[0], frame=0)
        useful = min(MOST_THREADS, os.cpu_count() or 1) if len(text.data) >= PARALLEL_BYTES else 1
        self._threads = threads or useful
        first = scan(text, frame=0)
        model = build_model(first, frame=0)
        self.objects = model.objects
        self.metadata = model.metadata
        self.notices = time_notices + model.notices
        self._first = _Structure(text, first)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = np.empty((stop - start, self.vertex_count, 3), np.float32)

        def read(frame: int) -> None:
            self._first.read_positions(self._paths[frame], frame, points[frame - start])

        with ThreadPoolExecutor(max_workers=min(self._threads, max(1, stop - start))) as pool:
            # map gives results in order, so the error raised is that of the first bad frame
            for _ in pool.map(read, range(start, stop)):
                pass
        return points


class _Structure:
    """What must not change from frame to frame, as bytes to compare quickly and as indices to compare well."""

    def __init__(self, text: ObjText, first: ObjScan) -> None:
        structure = np.empty(text.codes.size, np.uint8)
        lines = first.element_sizes.size + first.others.shape[0]
        before = np.empty((lines, 2), np.int32)
        length, used = copy_structure(text.codes, structure, before)
        self._bytes = structure[:length].copy()
        self._before = before[:used].copy()
        self._vertex_count = first.vertex_sizes.size
        self._element_kinds = first.element_kinds
        self._element_sizes = first.element_sizes
        self._corners = first.corners

    def read_positions(self, path: Path, frame: int, points: Float32Array) -> None:
        """Read a frame's positions into `points`, (vertices, 3) float32.

        Raises
        ------
        InputError
            If the file is unusable or its connectivity is another one.
        """
        text = read_text(path, frame=frame)
        starts = np.empty(points.size, np.int64)
        if find_positions(text.codes, self._bytes, self._before, starts):
            points[:] = text.parse(starts, frame=frame).reshape(points.shape)
        else:
            points[:] = self._read_in_full(text, frame)

    def _read_in_full(self, text: ObjText, frame: int) -> Float32Array:
        """Read a frame that is written differently, and find out whether it is different."""
        other = scan(text, frame=frame)
        build_model(other, frame=frame)  # refuses statements that carry geometry
        difference = self._difference(other)
        if difference:
            raise InputError(
                f"{difference}; every frame must have the connectivity of the first", path=text.path, frame=frame
            )
        return other.positions

    def _difference(self, other: ObjScan) -> str | None:
        vertices = other.vertex_sizes.size
        if vertices != self._vertex_count:
            return f"there are {vertices} vertices, the first frame has {self._vertex_count}"
        elements = other.element_sizes.size
        if elements != self._element_sizes.size:
            return f"there are {elements} faces, lines and points, the first frame has {self._element_sizes.size}"
        changed = np.flatnonzero(
            (other.element_sizes != self._element_sizes) | (other.element_kinds != self._element_kinds)
        )
        if changed.size:
            return f"face, line or point {changed[0]} has another size or kind than in the first frame"
        corners = np.flatnonzero((other.corners != self._corners).any(axis=1))
        if corners.size:
            element = int(np.searchsorted(np.cumsum(self._element_sizes), corners[0], side="right"))
            column = 0 if other.corners[corners[0], 0] != self._corners[corners[0], 0] else 1
            what = ("vertices", "texture vertices")[column]
            return f"face, line or point {element} has other {what} than in the first frame"
        return None
