"""What numbers of attributes that measure are: codes on a grid that holds them exactly, or places among all float32.

Texture coordinates and colours are seldom any float32: most are fractions of 255, of a power of two or of ten, or were
turned upside down (1 - v) after they were; and many take few values. All of it is found here, and nothing is lost: a
code gives the float32 back to the last bit, the sign of a zero and the payload of what is no number included.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.wedgepredict import COMPLEMENT, FLOAT, GRID, LARGEST_CODE, LINEAR_BITS

Float32Array = NDArray[np.float32]
Int64Array = NDArray[np.int64]

LARGEST_SHIFT = 127
"""Shifts are -127 to 127: values below 2^-97 are so near to 0 that how near does not help to predict them."""

FLOAT_BITS = 24
"""Of a float32's fraction: a grid with more points than that has none but float32 between them."""

DIVISORS = tuple(
    sorted({2**n for n in range(FLOAT_BITS + 7)} | {10**n for n in range(1, 9)} | {255, 1023, 4095, 32767, 65535})
)
"""Of the grids that are tried, from the coarsest on."""

GLANCE = 64
"""Values that a grid is tried on first."""


@dataclass(frozen=True)
class Scales:
    """What codes of channels stand for; see :mod:`pdecodec.kernels.wedgepredict`.

    Attributes
    ----------
    kinds, divisors : tuple of int
        One for each channel.
    shift : int
        Values times 2^shift are within 2^30.
    """

    kinds: tuple[int, ...]
    divisors: tuple[int, ...]
    shift: int


@dataclass(frozen=True)
class Channels:
    """Values as codes, (rows, channels) int64."""

    codes: Int64Array
    scales: Scales


def byte_scales(channels: int) -> Scales:
    """Of uint8 values, which are their own codes."""
    return Scales((GRID,) * channels, (1,) * channels, LINEAR_BITS - 8)


def codes_of_floats(values: Float32Array, *, divisor: int | None = None) -> Channels:
    """Codes of float32 values.

    Parameters
    ----------
    values : (rows, channels) float32
    divisor : int, optional
        Of a grid that is tried beside the usual ones.
    """
    finite = np.abs(values[np.isfinite(values)])
    largest = float(finite.max()) if finite.size else 0.0
    exponent = math.frexp(largest)[1]
    shift = min(LINEAR_BITS - exponent, LARGEST_SHIFT)
    columns = [np.ascontiguousarray(values[:, k]) for k in range(values.shape[1])]
    divisors = sorted({*DIVISORS, divisor or 1})
    found = [_on_a_grid(column, exponent, divisors) if shift >= 0 else None for column in columns]
    if any(each is not None for each in found):
        shift = min(shift, LINEAR_BITS)
    channels = [each or (FLOAT, 1, _places(column)) for each, column in zip(found, columns, strict=True)]
    kinds, chosen, codes = zip(*channels, strict=True)
    return Channels(np.stack(codes, axis=1), Scales(kinds, chosen, shift))


def floats_of_codes(channels: Channels) -> Float32Array:
    """(rows, channels) float32: undo :func:`codes_of_floats`."""
    values = np.empty(channels.codes.shape, np.float32)
    for k, (kind, divisor) in enumerate(zip(channels.scales.kinds, channels.scales.divisors, strict=True)):
        codes = channels.codes[:, k]
        values[:, k] = _floats(codes) if kind == FLOAT else _grid_values(codes, kind, divisor)
    return values


def within_tolerance(values: Float32Array, tolerance: float) -> tuple[Float32Array, int]:
    """The nearest points of a grid no farther than `tolerance` from any value, and the grid's divisor.

    Where there is no such grid of 32-bit codes, or values are on a coarser one, they stay as they are.
    """
    divisor = max(1, math.ceil(0.5 / tolerance))
    exact = codes_of_floats(values).scales
    if divisor <= LARGEST_CODE and (FLOAT in exact.kinds or max(exact.divisors) > divisor):
        wide = values.astype(np.float64)
        # Rounding to float32 may take a value farther than half of the grid: then the next finer one may do.
        for finer in (divisor, 2 * divisor):
            with np.errstate(invalid="ignore", over="ignore"):
                rounded = (np.rint(wide * finer) / finer).astype(np.float32)
                fits = np.abs(wide).max(initial=1) * finer <= LARGEST_CODE
                if fits and (np.abs(rounded - wide) <= tolerance).all():
                    return rounded, finer
    return values, divisor


def _on_a_grid(column: Float32Array, exponent: int, divisors: Sequence[int]) -> tuple[int, int, Int64Array] | None:
    """Kind, divisor and codes of the coarsest grid that holds all values, if there is one."""
    for divisor in divisors:
        if exponent + math.log2(divisor) > FLOAT_BITS:
            return None
        for kind in (GRID, COMPLEMENT) if divisor & (divisor - 1) else (GRID,):
            if _grid_codes(column[:GLANCE], kind, divisor) is not None:
                codes = _grid_codes(column, kind, divisor)
                if codes is not None:
                    return kind, divisor, codes
    return None


def _grid_codes(column: Float32Array, kind: int, divisor: int) -> Int64Array | None:
    wide = column.astype(np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        codes = np.rint((1.0 - wide if kind == COMPLEMENT else wide) * divisor)
    if not (np.abs(codes) <= LARGEST_CODE).all():
        return None
    found = codes.astype(np.int64)
    is_equal = _grid_values(found, kind, divisor).view(np.uint32) == column.view(np.uint32)
    return found if is_equal.all() else None


def _grid_values(codes: Int64Array, kind: int, divisor: int) -> Float32Array:
    values = (codes / np.float64(divisor)).astype(np.float32)
    return np.float32(1.0) - values if kind == COMPLEMENT else values


def _places(column: Float32Array) -> Int64Array:
    bits = column.view(np.int32).astype(np.int64)
    return np.where(bits < 0, -1 - (bits & LARGEST_CODE), bits)


def _floats(codes: Int64Array) -> Float32Array:
    bits = np.where(codes < 0, (-1 - codes) | (LARGEST_CODE + 1), codes)
    return bits.astype(np.uint32).view(np.float32)
