"""Find few functions of time that represent a motion: cubic or linear between frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.mesh.arrays import Float32Array, Float64Array

FIRST_SKETCH_RANK = 32
"""First rank that the randomised search for singular vectors tries: decoded objects have a rank of about 12."""


def fit(functions: Float64Array, rows: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Fit a rest shape and a shape per function (samples, count) by least squares: ``rest + functions @ shapes``."""
    found = np.linalg.pinv(np.column_stack([np.ones(len(functions)), functions])) @ rows
    return found[0], found[1:]


def cubic_keys(samples: Float64Array, times: Float64Array) -> Float64Array:
    """Return the keys of cubic splines through samples at frames and at the thirds between them.

    Parameters
    ----------
    samples : (3 (frames - 1) + 1, count) float64
        In the order of time.
    times : (frames,) float64 [s]

    Returns
    -------
    (frames, 3, count) float64
        In-tangent [1/s], value and out-tangent [1/s] of each frame. The cubic of an interval passes through its four
        samples, so motion that is cubic between frames is exact.
    """
    frames = times.size
    keys = np.zeros((frames, 3, samples.shape[1]))
    keys[:, 1] = samples[::3]
    if frames > 1:
        start, third, two_thirds, end = _intervals(samples)
        steps = np.diff(times)[:, None]
        keys[:-1, 2] = (-11 * start + 18 * third - 9 * two_thirds + 2 * end) / 2 / steps
        keys[1:, 0] = (-2 * start + 9 * third - 18 * two_thirds + 11 * end) / 2 / steps
    return keys


def _intervals(samples: Float64Array) -> list[Float64Array]:
    """Return the start, first third, second third and end of every interval, each (frames - 1, count)."""
    return [samples[offset::3][: len(samples) // 3] for offset in range(4)]


def _ranges(samples: Float64Array, *, cubic: bool) -> tuple[Float64Array, Float64Array]:
    """Return the minimum and maximum (count,) of each function over its samples, or over the cubics through them."""
    low, high = samples.min(axis=0), samples.max(axis=0)
    if not cubic:
        return low, high
    start, third, two_thirds, end = _intervals(samples)
    # On each interval f(s) = c0 + c1 s + c2 s^2 + c3 s^3 for s in [0, 1]; its extrema are where the derivative is zero.
    c1 = (-11 * start + 18 * third - 9 * two_thirds + 2 * end) / 2
    c2 = (18 * start - 45 * third + 36 * two_thirds - 9 * end) / 2
    c3 = (-9 * start + 27 * third - 27 * two_thirds + 9 * end) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(np.maximum(c2 * c2 - 3 * c1 * c3, 0))
        turns = [(-c2 + root) / (3 * c3), (-c2 - root) / (3 * c3), -c1 / (2 * c2)]
    for turn in turns:
        s = np.clip(np.nan_to_num(turn, posinf=0, neginf=0), 0, 1)
        values = start + s * (c1 + s * (c2 + s * c3))
        low, high = np.minimum(low, values.min(axis=0)), np.maximum(high, values.max(axis=0))
    return low, high


def find_functions(
    points: NDArray[np.floating], *bounds: float, most: int, cubic: bool = False
) -> tuple[Float64Array, Float32Array, Float32Array] | None:
    """Find the fewest functions of time that give positions as ``rest + functions @ shapes`` within a bound.

    Parameters
    ----------
    points : (samples, vertices, 3)
    *bounds : float
        Largest errors of a coordinate, increasing; the first that can be reached with `most` functions is used.
    most : int
        Largest number of functions; None is returned if more are needed.
    cubic : bool
        Whether samples lie at frames and at the thirds between them, with cubics through them.

    Returns
    -------
    functions : (samples, count) float64
        Exact in float32, and in [0, 1], also between samples.
    rest : (vertices, 3) float32
    shapes : (count, vertices, 3) float32
    """
    samples = len(points)
    rows = points.reshape(samples, -1).astype(np.float64)
    if not (rows - rows[0]).any():
        none = np.zeros((0, *points.shape[1:]), np.float32)
        return np.zeros((samples, 0)), points[0].astype(np.float32), none
    wide = rows - rows.mean(axis=0)
    energies, vectors = _leading_vectors(wide, bounds[0], most)
    # RMS error that remains if only the vectors before each one are used.
    left = np.sqrt(np.cumsum(energies[::-1])[::-1] / wide.size)
    most = min(most, len(energies))
    all_that_may_be = vectors[:, :most]
    least_error = np.abs(wide - all_that_may_be @ (all_that_may_be.T @ wide)).max()

    def try_count(count: int, bound: float) -> tuple[Float64Array, Float32Array, Float32Array] | None:
        low, high = _ranges(vectors[:, :count], cubic=cubic)
        functions = np.clip((vectors[:, :count] - low) / (high - low), 0, 1).astype(np.float32).astype(np.float64)
        rest, shapes = (one.astype(np.float32) for one in fit(functions, rows))
        if np.abs(rest + functions @ shapes.astype(np.float64) - rows).max() > bound:
            return None
        return functions, rest.reshape(points.shape[1:]), shapes.reshape(count, *points.shape[1:])

    def find_fewest(bound: float) -> tuple[Float64Array, Float32Array, Float32Array] | None:
        if least_error > bound:
            return None
        few = max(1, int(np.count_nonzero(left > bound / 2)))
        too_few, step = few - 1, 1
        found: tuple[Float64Array, Float32Array, Float32Array] | None = None
        while few <= most:
            found = try_count(few, bound)
            if found is not None or few == most:
                break
            too_few, few, step = few, min(few + step, most), 2 * step
        while found is not None and few - too_few > 1:
            middle = (few + too_few) // 2
            better = try_count(middle, bound)
            found, few, too_few = (found, few, middle) if better is None else (better, middle, too_few)
        return found

    return next((found for found in map(find_fewest, bounds) if found is not None), None)


def _leading_vectors(wide: Float64Array, bound: float, most: int) -> tuple[Float64Array, Float64Array]:
    """Return energies (count,), falling, and left singular vectors (samples, count) of rows: all, or the leading ones.

    If the rank is low, they are computed in the span of random combinations of the columns (Halko, Martinsson and
    Tropp 2011), which takes a fraction of the time of a full decomposition.
    """
    samples, columns = wide.shape
    width = FIRST_SKETCH_RANK
    while 4 * width <= min(samples, columns):
        # A fixed seed: the same rows give the same vectors.
        directions = np.random.default_rng(0).standard_normal((columns, width))
        basis = np.linalg.qr(wide @ (wide.T @ np.linalg.qr(wide @ directions)[0]))[0]
        inside = basis.T @ wide
        # Twice as many directions as are wanted hold the leading vectors, however large the remainder is.
        if width >= 2 * most or np.abs(wide - basis @ inside).max() <= bound / 4:
            energies, vectors = np.linalg.eigh(inside @ inside.T)
            return np.maximum(energies[::-1], 0), (basis @ vectors)[:, ::-1]
        width *= 2
    energies, vectors = np.linalg.eigh(wide @ wide.T)
    return np.maximum(energies[::-1], 0), vectors[:, ::-1]
