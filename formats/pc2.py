"""PC2 point caches, of 3ds Max and everyone after: little-endian; one start, one step, positions.

Layout: ``POINTCACHE2`` and a zero byte, int32 version (1), int32 points, float32 start [frames],
float32 step [frames], int32 samples, float32 positions[samples][points][3]. Times count frames, so the frame rate
is the reader's to know: ``--fps``, else 24 and a notice.
"""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np

from pdecodec.errors import InputError
from pdecodec.formats.point_cache import CACHE_NOTICE, PointCacheSequence, read_header, write_cache
from pdecodec.formats.sample_times import rate_or_default, regular_times
from pdecodec.sequence import MeshSequence, Progress

HEADER = struct.Struct("<12siiffi")

IDENTIFIER = b"POINTCACHE2\0"

VERSION = 1
"""The only one there is."""


def open_pc2(path: Path, *, fps: float | None, mesh: Path | str | None = None) -> MeshSequence:
    """Open a PC2 file.

    Parameters
    ----------
    path : pathlib.Path
    fps : float, optional
        Frames per second of the frames it counts; 24 where nobody says.
    mesh : path, optional
        Where names, faces and attributes come from.

    Raises
    ------
    InputError
        If it is truncated, no PC2 file, or the mesh does not fit.
    """
    identifier, version, points, start, step, frames = HEADER.unpack(read_header(path, HEADER.size))
    if identifier != IDENTIFIER or version != VERSION:
        raise InputError("is no PC2 file of version 1 (its first bytes are others)", path=path, offset=0)
    if not (points > 0 and frames > 0 and math.isfinite(start) and 0 < step < math.inf):
        raise InputError(
            f"its header says {frames} frames of {points} points from {start:g} by {step:g}: a damaged file", path=path
        )
    if points * frames > path.stat().st_size:
        raise InputError(f"is truncated: its header says {frames} frames of {points} points; write it again", path=path)
    rate, notices = rate_or_default(None, fps)
    return PointCacheSequence(
        path,
        start=HEADER.size,
        value_type="<f4",
        frames=frames,
        points=points,
        mesh=mesh,
        times=(start + np.arange(frames) * step) / rate,
        fps=rate,
        notices=notices,
    )


def write_pc2(
    sequence: MeshSequence,
    path: Path,
    *,
    overwrite: bool = False,
    fps: float | None = None,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Write positions, and times as a start and a step in frames.

    Raises
    ------
    InputError
        If the place is taken or cannot be written to.
    """
    rate = sequence.fps if fps is None else fps
    notices: tuple[str, ...] = (
        CACHE_NOTICE.format("PC2"),
        f"PC2 does not say its frame rate: read it with --fps {rate:.9g}",
    )
    rule = regular_times(sequence.times, rate)
    start = float(sequence.times[0]) * rate
    step = 1.0 if rule is None else rate / rule.rate
    if rule is None and sequence.frame_count > 1:
        notices += ("PC2 has one step between frames: irregular times are lost, frames are counted",)
    header = HEADER.pack(IDENTIFIER, VERSION, sequence.vertex_count, start, step, sequence.frame_count)
    write_cache(sequence, path, header=header, value_type="<f4", overwrite=overwrite, progress=progress, what="PC2")
    return notices
