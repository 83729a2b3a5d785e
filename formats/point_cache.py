"""What MDD and PC2 share: a header, then the positions of every frame as float32; faces come from another file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pdecodec.errors import InputError
from pdecodec.sequence import (
    Connectivity,
    Float32Array,
    Float64Array,
    MeshObject,
    MeshSequence,
    Progress,
    check_frame_range,
    check_times,
)
from pdecodec.whole_output import whole_file

CACHE_NOTICE = "{} holds positions and times alone; names, faces and attributes come back with --mesh"
"""What a person should know who writes a point cache."""


def mesh_objects(
    mesh: Path | str | None, points: int
) -> tuple[tuple[MeshObject, ...], dict[str, str], tuple[str, ...]]:
    """Objects and metadata of the file that a cache belongs to, and what to tell.

    Parameters
    ----------
    mesh : path or None
        Any file that can be opened; its first frame counts.
    points : int
        Points of a frame of the cache.

    Raises
    ------
    InputError
        If the mesh has another number of vertices.
    """
    if mesh is None:
        notice = "the cache holds no faces, they are points now; --mesh FILE says whose they are"
        return (MeshObject("mesh", Connectivity(points)),), {}, (notice,)
    from pdecodec.formats.registry import open_sequence

    with open_sequence(mesh) as sequence:
        if sequence.vertex_count != points:
            raise InputError(
                f"has {sequence.vertex_count} vertices, the cache has {points} points; take the mesh it was made from",
                path=mesh,
            )
        told = tuple(notice for notice in sequence.notices if not notice.startswith("assumed"))
        return sequence.objects, dict(sequence.metadata), told


class PointCacheSequence(MeshSequence):
    """Positions of a point cache under the objects of a mesh.

    Parameters
    ----------
    path : pathlib.Path
    start : int [bytes]
        Where frame 0 begins.
    value_type : str
        ``"<f4"`` or ``">f4"``.
    frames, points : int
    mesh : path or None
    times : (frames,) float64 [s]
    fps : float
    notices : sequence of str

    Raises
    ------
    InputError
        If the file is shorter than its header says, or the mesh does not fit.
    """

    def __init__(
        self,
        path: Path,
        *,
        start: int,
        value_type: str,
        frames: int,
        points: int,
        mesh: Path | str | None,
        times: Float64Array,
        fps: float,
        notices: Sequence[str],
    ) -> None:
        self._path, self._start, self._value_type = path, start, value_type
        self._frame_bytes = 12 * points
        needed, there = start + frames * self._frame_bytes, path.stat().st_size
        if there < needed:
            raise InputError(
                f"is truncated: its header says {frames} frames of {points} points, {needed} bytes; write it again",
                path=path,
                offset=there,
            )
        self.objects, self.metadata, mesh_notices = mesh_objects(mesh, points)
        self.times, self.fps = check_times(frames, times, fps)
        more = (f"{there - needed} bytes after the last frame are not read",) if there > needed else ()
        self.notices = (*notices, *mesh_notices, *more)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        with self._path.open("rb") as file:
            file.seek(self._start + start * self._frame_bytes)
            data = file.read((stop - start) * self._frame_bytes)
        if len(data) < (stop - start) * self._frame_bytes:
            raise InputError("was shortened while it was read", path=self._path, frame=start)
        return np.frombuffer(data, self._value_type).astype(np.float32).reshape(stop - start, -1, 3)


def read_header(path: Path, size: int) -> bytes:
    """The first `size` bytes.

    Raises
    ------
    InputError
        If there are fewer, or they cannot be read.
    """
    try:
        with path.open("rb") as file:
            head = file.read(size)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror}); check the file", path=path) from error
    if len(head) < size:
        raise InputError("ends inside its header; write it again", path=path, offset=len(head))
    return head


def write_cache(
    sequence: MeshSequence,
    path: Path,
    *,
    header: bytes,
    value_type: str,
    overwrite: bool,
    progress: Progress | None,
    what: str,
) -> None:
    """Write a header and every frame's positions, block by block."""
    with whole_file(path, overwrite=overwrite) as partial, partial.open("wb") as file:
        file.write(header)
        for start, block in sequence.blocks():
            file.write(block.astype(value_type).tobytes())
            if progress is not None:
                progress(start + len(block), sequence.frame_count, f"writing {what}")
