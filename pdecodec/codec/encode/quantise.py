"""Quantisation of coefficients: the grid of steps, dead zones, and what of them a group needs."""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec import _core
from pdecodec.codec.encode.temporal import TimeFunctions
from pdecodec.codec.encode.tuning import DeadZone
from pdecodec.codec.sections.space_basis import Rows, SpaceBasis
from pdecodec.mesh.arrays import Float64Array, Int64Array
from pdecodec.system.shares import in_shares, thread_count

BLOCK_BYTES = 2**25
"""Memory for values whose channels are projected and quantised together: all of them would take several times as much
as the group's positions."""

QUARTERS = (1.0, 1.189207115002721, 1.4142135623730951, 1.681792830507429)
"""Powers of the fourth root of two. Those that are computed differ in the last bit from one processor to another."""

HALF_WAY = (0.5452538663326288, 0.6484197773255048, 0.7711054127039704, 0.9170040432046712)
"""Half-way between these, from a half on: -7/8, -5/8, -3/8 and -1/8 as powers of two."""


def rounding_error(rounded_up_at: float) -> float:
    """Return the mean square of what rounding takes from a coefficient that does not become zero, in steps^2."""
    return (rounded_up_at**3 + (1.0 - rounded_up_at) ** 3) / 3.0


def grid_step(index: int) -> float:
    """Quantisation step of an index: powers of the fourth root of two, whatever the bound is.

    A bound that is a little looser then finds the very models that a tighter one found, and only residuals change.
    """
    octave, quarter = divmod(index, 4)
    return math.ldexp(QUARTERS[quarter], octave)


def grid_index(step: float) -> int:
    """Index of the step nearest to one."""
    share, octave = math.frexp(step)  # from a half to one
    return 4 * octave - 4 + bisect.bisect(HALF_WAY, share)


def axes_of(time: TimeFunctions) -> int:
    """Coefficients that a function of time has for each of space: one, or one an axis."""
    return 1 if time == "trajectories" else 3


def cosines_needed(largest: Int64Array) -> int:
    """Cosines up to the last that has a coefficient, by the largest of each channel."""
    used = np.flatnonzero(largest)
    return int(used[-1]) // axes_of("cosines") + 1 if used.size else 0


def needed_functions(largest: Int64Array, axes: int) -> NDArray[np.intp]:
    """Functions of time, of `axes` channels one, that have a coefficient, by the largest of each channel."""
    return np.flatnonzero(largest.reshape(-1, axes).any(axis=1))


def quantise(values: Float64Array, step: float, rounded_up_at: float) -> Int64Array:
    """Quantise with a dead zone: ``sign(x) floor(|x| / step + 1 - rounded_up_at)``."""
    return np.copysign(np.floor(np.abs(values) / step + (1.0 - rounded_up_at)), values).astype(np.int64)


def quantise_sparsely(values: Rows, step: float, axes: int, zone: DeadZone) -> tuple[Int64Array, Int64Array]:
    """:func:`quantise` coefficients (functions of space, channels), with a wider dead zone among zeros.

    Returns
    -------
    quantised : (functions of space, channels) int64
    largest : (channels,) int64
        Magnitude in each channel.
    """
    return _core.quantise_sparsely(np.ascontiguousarray(values), axes, step, *zone, thread_count())


Columns = Callable[[slice], Rows]
"""Values on vertices, (vertices, channels), of some functions of time."""


def columns_of(values: Rows, axes: int) -> Columns:
    """Those that an array has, each function of time `axes` channels; all of them as they are."""

    def columns(some: slice) -> Rows:
        channels = slice(axes * some.start, axes * some.stop)
        is_whole = (channels.start, channels.stop) == (0, values.shape[1])
        return np.ascontiguousarray(values) if is_whole else some_channels(values, channels)

    return columns


def some_channels(values: Rows, channels: slice) -> Rows:
    """A copy of some channels of values (vertices, channels)."""
    found = np.empty((len(values), channels.stop - channels.start), values.dtype)
    _copy_rows(found, values[:, channels])
    return found


def _copy_rows(to: NDArray[Any], rows: NDArray[Any]) -> None:
    """Copy rows in shares: memory that is written for the first time takes as long to be had as to be filled."""

    def copy(first: int, end: int) -> None:
        to[first:end] = rows[first:end]

    in_shares(copy, len(rows))


def quantise_on(
    basis: SpaceBasis, values: Columns, count: int, axes: int, step: float, zone: DeadZone
) -> tuple[Int64Array, Int64Array]:
    """:func:`quantise_sparsely` what values on vertices are in a space basis, of so many functions of time."""
    if 8 * axes * count * basis.functions <= BLOCK_BYTES:
        return quantise_sparsely(basis.project(values(slice(0, count))), step, axes, zone)
    quantised, largest = np.empty((basis.functions, axes * count), np.int64), np.zeros(axes * count, np.int64)
    for channels, some, some_largest in _blocks(basis, values, count, axes, step, zone):
        _copy_rows(quantised[:, channels], some)
        largest[channels] = some_largest
    return quantised, largest


def _blocks(
    basis: SpaceBasis, values: Columns, count: int, axes: int, step: float, zone: DeadZone
) -> Iterator[tuple[slice, Int64Array, Int64Array]]:
    """The same, some channels after others: which, their coefficients, and their largest magnitudes."""
    at_once = max(1, BLOCK_BYTES // (8 * axes * basis.functions))
    for begin in range(0, count, at_once):
        # With the neighbours, which tell a coefficient that is alone.
        first, end = max(0, begin - 1), min(begin + at_once, count)
        quantised, largest = quantise_sparsely(
            basis.project(values(slice(first, min(end + 1, count)))), step, axes, zone
        )
        own = slice(axes * (begin - first), axes * (end - first))
        yield slice(axes * begin, axes * end), quantised[:, own], largest[own]


def magnitudes(quantised: Int64Array) -> Int64Array:
    """The largest magnitude in each channel, (channels,) int64."""
    found: Int64Array = np.maximum(quantised.max(axis=0, initial=0), -quantised.min(axis=0, initial=0))
    return found
