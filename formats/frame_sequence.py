"""Sequences of one mesh file a frame, of any format that gives a mesh for a file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pdecodec.errors import InputError
from pdecodec.formats.frame_files import find_frames
from pdecodec.formats.sample_times import rate_or_default
from pdecodec.sequence import (
    Attribute,
    Connectivity,
    Float32Array,
    Float64Array,
    MeshObject,
    MeshSequence,
    check_frame_range,
)


@dataclass(frozen=True)
class MeshFile:
    """What one file holds.

    Attributes
    ----------
    points : (vertices, 3) float32
    connectivity : Connectivity
    attributes : tuple of Attribute
    notices : tuple of str
    """

    points: Float32Array
    connectivity: Connectivity
    attributes: tuple[Attribute, ...] = ()
    notices: tuple[str, ...] = ()


ReadMesh = Callable[[Path], MeshFile]


class FrameSequence(MeshSequence):
    """Files whose frames are read, and compared with the first, when they are asked for.

    Parameters
    ----------
    paths : sequence of pathlib.Path
    times : (frames,) float64 [s]
    fps : float
    read : callable
        Gives the mesh of a file; raises InputError.
    notices : sequence of str
    """

    def __init__(
        self, paths: Sequence[Path], times: Float64Array, fps: float, read: ReadMesh, notices: Sequence[str] = ()
    ) -> None:
        self._paths, self._read = tuple(paths), read
        first = read(self._paths[0])
        if len(first.points) == 0:
            raise InputError("there are no vertices; check the file", path=self._paths[0])
        self._connectivity = first.connectivity
        self.objects = (MeshObject("mesh", first.connectivity, first.attributes),)
        self.times, self.fps = times, fps
        self.metadata = {}
        self.notices = (*notices, *first.notices)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = np.empty((stop - start, self.vertex_count, 3), np.float32)
        for frame in range(start, stop):
            found = self._read(self._paths[frame])
            if not found.connectivity.same_as(self._connectivity):
                raise InputError(
                    f"{_difference(found.connectivity, self._connectivity)}; every frame must have the connectivity of "
                    "the first",
                    path=self._paths[frame],
                    frame=frame,
                )
            points[frame - start] = found.points
        return points


def open_frames(path: Path, extension: str, read: ReadMesh, fps: float | None) -> MeshSequence:
    """A file, a frame pattern or a folder as a sequence; frame numbers over the rate are the times.

    Raises
    ------
    InputError
        If frames are missing, or the first one cannot be used.
    """
    files = find_frames(path, extension)
    rate, notices = rate_or_default(None, fps)
    if files.numbers is None:
        return FrameSequence(files.paths, np.zeros(1), rate, read)
    return FrameSequence(files.paths, np.asarray(files.numbers, np.float64) / rate, rate, read, notices)


def _difference(mine: Connectivity, first: Connectivity) -> str:
    if mine.vertex_count != first.vertex_count:
        return f"there are {mine.vertex_count} vertices, the first frame has {first.vertex_count}"
    if mine.face_count != first.face_count or mine.line_count != first.line_count:
        return f"there are {mine.face_count} faces and {mine.line_count} lines, the first frame has others"
    return "faces or lines join other vertices than in the first frame"
