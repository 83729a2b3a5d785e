"""Read and write point caches: a header, then float32 positions of every frame; faces come from another file.

MDD, introduced by LightWave, is big-endian: int32 frames, int32 points, float32 times[frames] [s], float32
positions[frames][points][3]. Times within float32 rounding of the frames of a rate are restored exactly.

PC2, introduced by 3ds Max, is little-endian: ``POINTCACHE2`` and a zero byte, int32 version (1), int32 points,
float32 start [frames], float32 step [frames], int32 samples, float32 positions[samples][points][3]. Times are
counted in frames, so the reader must know the frame rate: `fps`, else 24 with a notice.
"""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np

from pdecodec.errors import InputError, Notice, damaged
from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.opening import open_sequence
from pdecodec.formats.base.registry import Output, read_errors
from pdecodec.formats.base.times import (
    FLOAT32_ROUNDING,
    Timing,
    rate_or_default,
    regular_rate,
    round_rate,
    snapped_times,
)
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.sequence import Connectivity, Content, MeshObject, MeshSequence, check_frame_range
from pdecodec.mesh.times import check_times

MDD_HEADER, PC2_HEADER = struct.Struct(">ii"), struct.Struct("<12siiffi")

PC2_IDENTIFIER, PC2_VERSION = b"POINTCACHE2\0", 1

Mesh = Path | str | None
"""File or input that names, faces and attributes come from; None for points."""


class PointCacheSequence(MeshSequence):
    """Positions of a point cache, from byte `start` on as ``<f4`` or ``>f4``, with the objects of a mesh.

    Raises
    ------
    InputError
        If the file is shorter than its header says, or the mesh has a different number of vertices.
    """

    def __init__(
        self, path: Path, start: int, value_type: str, frames: int, points: int, mesh: Mesh, timing: Timing
    ) -> None:
        self._path, self._start, self._value_type = path, start, value_type
        self._frame_bytes = 12 * points
        needed, there = start + frames * self._frame_bytes, path.stat().st_size
        if there < needed:
            raise damaged(
                f"is truncated: its header says {frames} frames of {points} points, {needed} bytes; write it again",
                path=path,
                offset=there,
            )
        times, rate, notices = timing
        self.times, self.fps = check_times(frames, times, rate)
        rest = ["bytes after the last frame"] if there > needed else []
        more = not_kept(rest, f"{there - needed} {{}} are not read")
        self.notices = (*notices, *self._take_mesh(mesh, points), *more)
        self.list_contents = lambda: (
            *(Content(f"/{kind}", kind, "coded") for kind in ("times", "positions")),
            *(Content(f"/{kind}", kind, "dropped") for kind in rest),
        )

    def _take_mesh(self, mesh: Mesh, points: int) -> tuple[str, ...]:
        """Take objects and metadata from the mesh; return notices about it."""
        if mesh is None:
            self.objects, self.metadata = (MeshObject("mesh", Connectivity(points)),), {}
            text = "the cache has no faces: its vertices are points"
            return (Notice(text, setting="mesh", purpose="to take faces from a file"),)
        with open_sequence(mesh) as sequence:
            if sequence.vertex_count != points:
                there = f"has {sequence.vertex_count} vertices, the cache has {points} points"
                raise InputError(f"{there}; take the mesh it was made from", code="object-mismatch", path=mesh)
            self.objects, self.metadata = sequence.objects, dict(sequence.metadata)
            return tuple(notice for notice in sequence.notices if getattr(notice, "setting", None) != "fps")

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        with self._path.open("rb") as file:
            file.seek(self._start + start * self._frame_bytes)
            data = file.read((stop - start) * self._frame_bytes)
        if len(data) < (stop - start) * self._frame_bytes:
            raise damaged("became shorter while it was read", path=self._path, frame=start)
        return np.frombuffer(data, self._value_type).astype(np.float32).reshape(stop - start, self.vertex_count, 3)


def open_mdd(path: Path, *, fps: float | None, mesh: Mesh = None) -> MeshSequence:
    """Open an MDD file; `fps` is the nominal rate.

    Raises
    ------
    InputError
        If it is truncated, its header is not valid, its times do not increase, or the mesh does not fit.
    """
    frames, points = MDD_HEADER.unpack(_read_header(path, MDD_HEADER.size))
    size = path.stat().st_size
    if not (0 < frames <= size and 0 < points <= size):
        raise damaged(f"its header says {frames} frames of {points} points: not an MDD file, or damaged", path=path)
    start = MDD_HEADER.size + 4 * frames
    stored = np.frombuffer(_read_header(path, start)[MDD_HEADER.size :], ">f4").astype(np.float64)
    times, found = _remove_rounding(stored, fps)
    return PointCacheSequence(path, start, ">f4", frames, points, mesh, (times, *rate_or_default(found, fps)))


def open_pc2(path: Path, *, fps: float | None, mesh: Mesh = None) -> MeshSequence:
    """Open a PC2 file; `fps` is the rate of the frames in which it counts time.

    Raises
    ------
    InputError
        If it is truncated, is not a PC2 file, or the mesh does not fit.
    """
    identifier, version, points, start, step, frames = PC2_HEADER.unpack(_read_header(path, PC2_HEADER.size))
    if (identifier, version) != (PC2_IDENTIFIER, PC2_VERSION):
        raise damaged("is not a PC2 file of version 1 (its first bytes differ)", path=path, offset=0)
    if not (points > 0 and frames > 0 and math.isfinite(start) and 0 < step < math.inf):
        raise damaged(
            f"its header says {frames} frames of {points} points from {start:g} by {step:g}: a damaged file", path=path
        )
    if points * frames > path.stat().st_size:
        raise damaged(f"is truncated: its header says {frames} frames of {points} points; write it again", path=path)
    rate, notices = rate_or_default(None, fps)
    timing = ((start + np.arange(frames) * step) / rate, rate, notices)
    return PointCacheSequence(path, PC2_HEADER.size, "<f4", frames, points, mesh, timing)


def write_mdd(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write positions and times; refused if two times are equal in float32."""
    times = sequence.times.astype(">f4")
    if (np.diff(times.astype(np.float64)) <= 0).any():
        raise InputError(
            "two times are equal in MDD's float32; choose another format or fewer frames", code="invalid-times"
        )
    header = MDD_HEADER.pack(sequence.frame_count, sequence.vertex_count) + times.tobytes()
    return _write_cache(sequence, output, "MDD", header, ">f4")


def write_pc2(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write positions, and times as start and step in frames."""
    found = regular_rate(sequence.times, output.rate)
    start = float(sequence.times[0]) * output.rate
    step = 1.0 if found is None else output.rate / found
    with np.errstate(over="ignore"):
        held = np.array([start, step]).astype(np.float32)
    if not (np.isfinite(held).all() and held[1] > 0):
        raise InputError(
            f"PC2's float32 cannot count frames at {output.rate:g} per second; set a usual frame rate",
            code="invalid-times",
        )
    header = PC2_HEADER.pack(PC2_IDENTIFIER, PC2_VERSION, sequence.vertex_count, start, step, sequence.frame_count)
    notices = _write_cache(sequence, output, "PC2", header, "<f4")
    text = "PC2 does not store the frame rate"
    notices += (Notice(text, setting="fps", value=f"{output.rate:.9g}", purpose="when it is read"),)
    if found is None and sequence.frame_count > 1:
        notices += ("PC2 has one step between frames: irregular times are lost, frames are counted",)
    return notices


def _read_header(path: Path, size: int) -> bytes:
    """Return the first `size` bytes; InputError if there are fewer or they cannot be read."""
    with read_errors(path), path.open("rb") as file:
        head = file.read(size)
    if len(head) < size:
        raise damaged("ends inside its header; write it again", path=path, offset=len(head))
    return head


def _write_cache(sequence: MeshSequence, output: Output, what: str, header: bytes, value_type: str) -> tuple[str, ...]:
    with output.whole_file() as partial, partial.open("wb") as file:
        file.write(header)
        for _, block in output.blocks(sequence, what):
            file.write(block.astype(value_type).tobytes())
    text = f"{what} holds positions and times alone; names, faces and attributes come from another file"
    return (Notice(text, setting="mesh", purpose="when it is read"),)


def _remove_rounding(stored: Float64Array, fps: float | None) -> tuple[Float64Array, float | None]:
    """Return times with the rounding to float32 undone, and the frame rate of which they are multiples."""
    if stored.size < 2 or not np.isfinite(stored).all() or (np.diff(stored) <= 0).any():
        return stored, None
    slack = FLOAT32_ROUNDING * float(np.abs(stored).max())
    spacing = float(np.median(np.diff(stored)))
    rough = (stored.size - 1) / float(stored[-1] - stored[0])
    # A rate can be recognised only if rounding is far below the spacing of the times.
    rates = (float(round(rough)), round(rough * 1.001) / 1.001, round_rate(rough)) if slack / spacing < 0.01 else ()
    for rate in (fps, *rates):
        if rate:
            times = snapped_times(stored, rate, slack)
            if times is not stored:
                return times, rate
    return stored, float(round(1.0 / spacing, 3)) or None
