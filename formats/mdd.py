"""MDD point caches, of LightWave and everyone after: big-endian; frames, points, times, positions.

Layout: int32 frames, int32 points, float32 times[frames] [s], float32 positions[frames][points][3].
Times are float32 in the file. Those that are frames of a rate but for that rounding come back without it.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from pdecodec.errors import InputError
from pdecodec.formats.point_cache import CACHE_NOTICE, PointCacheSequence, read_header, write_cache
from pdecodec.formats.sample_times import rate_or_default, round_rate, snapped_times
from pdecodec.sequence import Float64Array, MeshSequence, Progress

HEADER = struct.Struct(">ii")

FLOAT32_ROUNDING = 2.0**-23
"""Relative error of a time after float32, with a bit to spare."""


def open_mdd(path: Path, *, fps: float | None, mesh: Path | str | None = None) -> MeshSequence:
    """Open an MDD file.

    Parameters
    ----------
    path : pathlib.Path
    fps : float, optional
        Nominal rate; the file stores its times.
    mesh : path, optional
        Where names, faces and attributes come from.

    Raises
    ------
    InputError
        If it is truncated, its header is no MDD header, its times do not increase, or the mesh does not fit.
    """
    frames, points = HEADER.unpack(read_header(path, HEADER.size))
    size = path.stat().st_size
    if not (frames > 0 and points > 0 and frames <= size and points <= size):
        raise InputError(
            f"its header says {frames} frames of {points} points: no MDD file, or a damaged one", path=path
        )
    start = HEADER.size + 4 * frames
    stored = np.frombuffer(read_header(path, start)[HEADER.size :], ">f4").astype(np.float64)
    times, found = _without_rounding(stored, fps)
    rate, notices = rate_or_default(found, fps)
    return PointCacheSequence(
        path,
        start=start,
        value_type=">f4",
        frames=frames,
        points=points,
        mesh=mesh,
        times=times,
        fps=rate,
        notices=notices,
    )


def write_mdd(
    sequence: MeshSequence,
    path: Path,
    *,
    overwrite: bool = False,
    fps: float | None = None,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Write positions and times.

    Raises
    ------
    InputError
        If the place is taken or cannot be written to, or two times are one in float32.
    """
    times = sequence.times.astype(">f4")
    if (np.diff(times.astype(np.float64)) <= 0).any():
        raise InputError("two times are the same in MDD's float32; take another format, or fewer frames")
    header = HEADER.pack(sequence.frame_count, sequence.vertex_count) + times.tobytes()
    write_cache(sequence, path, header=header, value_type=">f4", overwrite=overwrite, progress=progress, what="MDD")
    return (CACHE_NOTICE.format("MDD"),)


def _without_rounding(stored: Float64Array, fps: float | None) -> tuple[Float64Array, float | None]:
    """Times without what float32 did to them, and the rate that tells so."""
    if stored.size < 2 or not np.isfinite(stored).all() or (np.diff(stored) <= 0).any():
        return stored, None
    slack = FLOAT32_ROUNDING * float(np.abs(stored).max())
    spacing = float(np.median(np.diff(stored)))
    rough = (stored.size - 1) / float(stored[-1] - stored[0])
    # Only where rounding is far below the spacing do times say which rate they are frames of.
    rates = (float(round(rough)), round(rough * 1.001) / 1.001, round_rate(rough)) if slack / spacing < 0.01 else ()
    for rate in (fps, *rates):
        if rate:
            times = snapped_times(stored, rate, slack)
            if times is not stored:
                return times, rate
    return stored, float(round(1.0 / spacing, 3)) or None
