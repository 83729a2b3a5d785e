"""Quantisation of coefficients: the grid of steps, dead zones, and which functions of time keep a coefficient."""

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
"""Memory for values whose channels are projected and quantised together. All channels at once would take
several times the memory of the group's positions.
"""

QUARTERS = (1.0, 1.189207115002721, 1.4142135623730951, 1.681792830507429)
"""Powers of the fourth root of two, as literals: computed ones differ in the last bit between processors."""

HALF_WAY = (0.5452538663326288, 0.6484197773255048, 0.7711054127039704, 0.9170040432046712)
"""Powers of two halfway between those, starting above a half: exponents -7/8, -5/8, -3/8 and -1/8."""


def rounding_error(rounded_up_at: float) -> float:
    """Return the mean square rounding error, in steps^2, of a coefficient that does not become zero."""
    return (rounded_up_at**3 + (1.0 - rounded_up_at) ** 3) / 3.0


def grid_step(index: int) -> float:
    """Return the quantisation step of an index: a power of the fourth root of two, independent of the bound.

    A slightly looser bound then finds the same models as a tighter one, and only residuals change.
    """
    octave, quarter = divmod(index, 4)
    return math.ldexp(QUARTERS[quarter], octave)


def grid_index(step: float) -> int:
    """Return the index of the step nearest to `step`."""
    share, octave = math.frexp(step)  # share is between a half and one
    return 4 * octave - 4 + bisect.bisect(HALF_WAY, share)


def axes_of(time: TimeFunctions) -> int:
    """Return how many coefficients a function of time has for each function of space: one, or one per axis."""
    return 1 if time == "trajectories" else 3


def cosines_needed(largest: Int64Array) -> int:
    """Return the number of cosines up to the last one that has a coefficient, given the largest magnitude per
    channel.
    """
    used = np.flatnonzero(largest)
    return int(used[-1]) // axes_of("cosines") + 1 if used.size else 0


def needed_functions(largest: Int64Array, axes: int) -> NDArray[np.intp]:
    """Return the functions of time, of `axes` channels each, that have a coefficient, given the largest
    magnitude per channel.
    """
    return np.flatnonzero(largest.reshape(-1, axes).any(axis=1))


def quantise(values: Float64Array, step: float, rounded_up_at: float) -> Int64Array:
    """Quantise with a dead zone: ``sign(x) floor(|x| / step + 1 - rounded_up_at)``."""
    return np.copysign(np.floor(np.abs(values) / step + (1.0 - rounded_up_at)), values).astype(np.int64)


def quantise_sparsely(values: Rows, step: float, axes: int, zone: DeadZone) -> tuple[Int64Array, Int64Array]:
    """Quantise coefficients (functions of space, channels) like :func:`quantise`, with a wider dead zone among zeros.

    Returns
    -------
    quantised : (functions of space, channels) int64
    largest : (channels,) int64
        Largest magnitude per channel.
    """
    return _core.quantise_sparsely(np.ascontiguousarray(values), axes, step, *zone, thread_count())


Columns = Callable[[slice], Rows]
"""Function that returns values on vertices, (vertices, channels), of a slice of the functions of time."""


def columns_of(values: Rows, axes: int) -> Columns:
    """Return a function that takes channels from an array, `axes` channels per function of time."""

    def columns(some: slice) -> Rows:
        channels = slice(axes * some.start, axes * some.stop)
        is_whole = (channels.start, channels.stop) == (0, values.shape[1])
        return np.ascontiguousarray(values) if is_whole else some_channels(values, channels)

    return columns


def some_channels(values: Rows, channels: slice) -> Rows:
    """Return a copy of some channels of values (vertices, channels)."""
    found = np.empty((len(values), channels.stop - channels.start), values.dtype)
    _copy_rows(found, values[:, channels])
    return found


def _copy_rows(to: NDArray[Any], rows: NDArray[Any]) -> None:
    """Copy rows in several threads: the first write to new memory costs as much as filling it."""

    def copy(first: int, end: int) -> None:
        to[first:end] = rows[first:end]

    in_shares(copy, len(rows))


def quantise_on(
    basis: SpaceBasis, values: Columns, count: int, axes: int, step: float, zone: DeadZone
) -> tuple[Int64Array, Int64Array]:
    """Project values of `count` functions of time onto a spatial basis and quantise them with
    :func:`quantise_sparsely`.
    """
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
    """Project and quantise in blocks of channels: yield the channels, their coefficients, and their largest
    magnitudes.
    """
    at_once = max(1, BLOCK_BYTES // (8 * axes * basis.functions))
    for begin in range(0, count, at_once):
        # Include the neighbouring functions, which decide whether a coefficient is isolated.
        first, end = max(0, begin - 1), min(begin + at_once, count)
        quantised, largest = quantise_sparsely(
            basis.project(values(slice(first, min(end + 1, count)))), step, axes, zone
        )
        own = slice(axes * (begin - first), axes * (end - first))
        yield slice(axes * begin, axes * end), quantised[:, own], largest[own]


def magnitudes(quantised: Int64Array) -> Int64Array:
    """Return the largest magnitude per channel, (channels,) int64."""
    found: Int64Array = np.maximum(quantised.max(axis=0, initial=0), -quantised.min(axis=0, initial=0))
    return found
