"""Find few functions of time that represent a motion: cubic or linear between frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array

FIRST_SKETCH_RANK = 32
"""Rank that the randomised search for singular vectors tries first: decoded objects have a rank of about 12."""

LEAST_PROBED_COLUMNS = 512
"""Number of coordinates in the first sample from which functions are found. The sample doubles until it has two
coordinates for each function.
"""

PROBING_ROUNDS = 12
"""How often functions are searched for in a growing sample, for one bound: a larger sample would hold most
coordinates.
"""

READ_BYTES, FIT_BYTES = 2**21, 2**24
"""Bytes of float32 rows that are read at once, and of float64 shapes that are summed at once."""

Blocks = Callable[[], Iterable[tuple[int, Float32Array]]]
"""A function that returns consecutive blocks of positions (n, vertices, 3), each with its first index; called
for every pass.
"""


@dataclass(frozen=True)
class Samples:
    """Rows of three numbers that change with time, read as often as needed.

    Attributes
    ----------
    count, columns : int
        Number of samples in time, and of numbers in a sample.
    read : callable
        Yields blocks (n, rows, 3) in any order, each with the indices (n,) of its samples in the order of time.
    """

    count: int
    columns: int
    read: Callable[[], Iterator[tuple[Int64Array, Float32Array]]]

    @classmethod
    def of_frames(cls, frames: Float32Array, thirds: Blocks | None = None) -> Samples:
        """Return the samples of a motion at frames (frames, vertices, 3) and at the thirds between them, if known."""
        stride = 1 if thirds is None else 3

        def read() -> Iterator[tuple[Int64Array, Float32Array]]:
            for start, points in split(0, frames):
                yield stride * np.arange(start, start + len(points)), points
            for first, block in () if thirds is None else thirds():
                for start, points in split(first, block):
                    numbers = np.arange(start, start + len(points))
                    yield 3 * (numbers // 2) + 1 + numbers % 2, points

        return cls(stride * (len(frames) - 1) + 1, 3 * frames.shape[1], read)

    def rows(self) -> Iterator[tuple[Int64Array, Float32Array]]:
        """Yield blocks (n, columns) as :attr:`read` does."""
        return ((where, points.reshape(len(points), -1)) for where, points in self.read())

    def first(self) -> Float32Array:
        """Return the first sample (rows, 3)."""
        return next(points[0] for where, points in self.read() if where[0] == 0)

    def moves(self) -> bool:
        """Return whether a sample differs from the first."""
        first = self.first()
        return any(not (points == first).all() for _, points in self.read())

    def at(self, columns: Int64Array) -> Float64Array:
        """Return some of the columns (samples, n)."""
        found = np.empty((self.count, columns.size))
        for where, rows in self.rows():
            found[where] = rows[:, columns]
        return found

    def largest_errors(self, functions: Float64Array, shapes: Float32Array) -> Float64Array:
        """Return the largest error (columns,) of sums of functions and shapes, as :func:`fit` returns them."""
        largest = np.zeros(self.columns)
        step = max(1, FIT_BYTES // (8 * len(shapes)))
        for where, rows in self.rows():
            for start in range(0, self.columns, step):
                own = slice(start, start + step)
                rest, *_ = part = shapes[:, own].astype(np.float64)
                off = functions[where] @ part[1:]
                off += rest
                off -= rows[:, own]
                np.maximum(largest[own], np.abs(off, out=off).max(axis=0), out=largest[own])
        return largest


def split(start: int, points: Float32Array) -> Iterator[tuple[int, Float32Array]]:
    """Yield positions (frames, vertices, 3) in blocks of at most :data:`READ_BYTES`, each with its first index."""
    step = max(1, READ_BYTES // max(1, 12 * points.shape[1]))
    for first in range(0, len(points), step):
        yield start + first, points[first : first + step]


def fit(samples: Samples, functions: Float64Array) -> Float32Array:
    """Fit a rest shape and a shape per function (samples, count) by least squares: (1 + count, columns) float32."""
    solution = _pseudo_inverse(functions)
    found = np.empty((len(solution), samples.columns), np.float32)
    step = max(1, FIT_BYTES // (8 * len(solution)))
    for start in range(0, samples.columns, step):
        own = slice(start, start + step)
        total = np.zeros(found[:, own].shape)
        for where, rows in samples.rows():
            total += solution[:, where] @ rows[:, own]
        found[:, own] = total
    return found


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
    samples: Samples,
    *bounds: float,
    most: int,
    cubic: bool = False,
    known: Float64Array | None = None,
) -> tuple[Float64Array, Float32Array] | None:
    """Find the fewest functions of time that give positions as ``rest + functions @ shapes`` within a bound.

    Functions are found in a sample of the coordinates. Then all coordinates are fitted and compared. Those that are
    not within the bound join the sample, and functions are searched for again. So a motion is read a few times, and
    never held in memory.

    Parameters
    ----------
    samples : Samples
    *bounds : float
        Largest errors of a coordinate, increasing; the first that can be reached with `most` functions is used.
    most : int
        Largest number of functions in addition to the known ones; None is returned if more are needed.
    cubic : bool
        Whether samples lie at frames and at the thirds between them, with cubics through them.
    known : (samples, count) float64, optional
        Functions to begin with. Without them, at least one function is found for anything that moves.

    Returns
    -------
    functions : (samples, count) float64
        The known functions and those found. The latter are exact in float32, and within [0, 1], also between samples.
    shapes : (1 + count, vertices, 3) float32
        The rest shape, and the shape of each function.
    """
    given = np.zeros((samples.count, 0)) if known is None else known
    if known is None and not samples.moves():
        return given, samples.first()[None].astype(np.float32)
    # Together with the rest shape, at most as many functions as samples are independent.
    most = min(most, samples.count - 1 - given.shape[1])
    # A fixed seed: the same motion gives the same functions.
    order = np.random.default_rng(0).permutation(samples.columns)
    size, wanted = LEAST_PROBED_COLUMNS, min(samples.columns, 2 * most)
    probe = _Probe(samples.at(order[:size]), given, most, bounds, cubic=cubic)
    for bound in bounds:
        for _ in range(PROBING_ROUNDS):
            if size < wanted and 2 * probe.estimate(bound) > probe.columns:
                more, size = order[size : 2 * size], 2 * size
            else:
                functions = probe.find_fewest(bound, least=int(known is None))
                if functions is None:
                    break
                shapes = fit(samples, functions)
                errors = samples.largest_errors(functions, shapes)
                if errors.max() <= bound:
                    return functions, shapes.reshape(-1, samples.columns // 3, 3)
                beyond = np.flatnonzero(errors > bound)
                more = beyond[np.argsort(-errors[beyond], kind="stable")][: max(LEAST_PROBED_COLUMNS, most)]
            probe.add(samples.at(more))
    return None


def _pseudo_inverse(functions: Float64Array) -> Float64Array:
    """Return the matrix that maps samples to the least-squares rest shape and shapes: (1 + count, samples)."""
    ordinates, triangle = np.linalg.qr(np.column_stack([np.ones(len(functions)), functions]))
    return np.asarray(np.linalg.solve(triangle, ordinates.T))


class _Probe:
    """Some coordinates of a motion (samples, columns), and the functions of time that represent them."""

    def __init__(
        self, rows: Float64Array, known: Float64Array, most: int, bounds: Sequence[float], *, cubic: bool
    ) -> None:
        self._rows, self._known, self._bounds, self._cubic = rows, known, bounds, cubic
        self._basis = np.linalg.qr(np.column_stack([np.ones(len(rows)), known]))[0]
        self._allowed = most
        self._analyse(0)

    @property
    def columns(self) -> int:
        """Number of coordinates."""
        return int(self._rows.shape[1])

    def add(self, rows: Float64Array) -> None:
        """Add coordinates (samples, columns)."""
        rank = self.estimate(self._bounds[0])
        self._vectors = np.zeros((0, 0))  # Free the old vectors first: the new ones are as large.
        self._rows = np.hstack([self._rows, rows])
        self._analyse(rank)

    def _analyse(self, rank: int) -> None:
        wide = self._rows - self._basis @ (self._basis.T @ self._rows)
        energies, self._vectors = _leading_vectors(wide, self._bounds[0], self._allowed, rank)
        self._most = min(self._allowed, len(energies))
        # For each number of vectors, the RMS error that remains if only these are used.
        self._left = np.sqrt(np.cumsum(energies[::-1])[::-1] / max(1, wide.size))
        self._least_error = np.inf
        if len(self._left) > self._most and self._left[self._most] > self._bounds[-1]:
            return
        all_that_may_be = self._vectors[:, : self._most]
        wide -= all_that_may_be @ (all_that_may_be.T @ wide)
        self._least_error = float(np.abs(wide, out=wide).max(initial=0))

    def estimate(self, bound: float) -> int:
        """Return how many vectors bring the RMS error to half a bound; a few more bring every error within the
        bound.
        """
        return int(np.count_nonzero(self._left > bound / 2))

    def find_fewest(self, bound: float, *, least: int) -> Float64Array | None:
        """Return the known functions and the fewest others, but at least `least`; None if too many are needed."""
        if self._least_error > bound:
            return None
        if not least and self._try_count(0, bound) is not None:
            return self._known
        few = max(1, least, self.estimate(bound))
        too_few, step = few - 1, 1
        found: Float64Array | None = None
        while few <= self._most:
            found = self._try_count(few, bound)
            if found is not None or few == self._most:
                break
            too_few, few, step = few, min(few + step, self._most), 2 * step
        while found is not None and few - too_few > 1:
            middle = (few + too_few) // 2
            better = self._try_count(middle, bound)
            found, few, too_few = (found, few, middle) if better is None else (better, middle, too_few)
        return found

    def _try_count(self, count: int, bound: float) -> Float64Array | None:
        low, high = _ranges(self._vectors[:, :count], cubic=self._cubic)
        if (high <= low).any():
            return None  # the function does not change
        more = np.clip((self._vectors[:, :count] - low) / (high - low), 0, 1).astype(np.float32)
        functions = np.column_stack([self._known, more.astype(np.float64)])
        basis = np.column_stack([np.ones(len(functions)), functions])
        shapes = (_pseudo_inverse(functions) @ self._rows).astype(np.float32).astype(np.float64)
        off = basis @ shapes
        off -= self._rows
        return functions if np.abs(off, out=off).max(initial=0) <= bound else None


def _leading_vectors(wide: Float64Array, bound: float, most: int, rank: int) -> tuple[Float64Array, Float64Array]:
    """Return energies (count,), decreasing, and left singular vectors (samples, count) of rows: all, or the leading
    ones.

    If the rank is low, and at least `rank`, they are computed in the span of random combinations of the columns
    (Halko, Martinsson and Tropp 2011), which takes a fraction of the time of a full decomposition.
    """
    samples, columns = wide.shape
    width = max(FIRST_SKETCH_RANK, rank)
    basis = np.zeros((samples, 0))
    while 4 * width <= min(samples, columns):
        directions = np.random.default_rng(0).standard_normal((columns, width))
        basis = np.linalg.qr(wide @ (wide.T @ np.linalg.qr(wide @ directions)[0]))[0]
        # Twice as many directions as wanted contain the leading vectors, however large the remainder is.
        if width >= 2 * most or np.abs(wide - basis @ (basis.T @ wide)).max() <= bound / 4:
            break
        width *= 2
    else:
        basis = np.linalg.qr(wide)[0] if columns < samples else np.eye(samples)
    inside = basis.T @ wide
    energies, vectors = np.linalg.eigh(inside @ inside.T)
    return np.maximum(energies[::-1], 0), (basis @ vectors)[:, ::-1]
