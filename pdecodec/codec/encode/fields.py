"""Fields: values that change in time, as whole numbers, and the way in which their chunks are coded (section FDAT).

A measured field is stored in steps of twice its bound, or in fractions of a step where its predictions are finer; an
exact field (integers, booleans, floats whose bits must come back) as the numbers themselves. Coder:
`core/sections/fields/`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec import _core
from pdecodec.mesh.arrays import Int64Array

Kinds = NDArray[np.uint8]

LARGEST_VALUE = 2**36
"""Largest magnitude of a whole number in a chunk."""

CODINGS = ((0, 1), (1, 1), (6, 15))
"""Ways to code a chunk that an encoder tries: levels of frames between frames, and the fractions of a step. Without the
second, fields of the shared clips cost 0.3 % more; without the third, smooth ones up to three times as much."""

GROUP_VALUES = 1 << 20
"""Values of a group of frames, about: as many as decode in a tenth of a second."""

MAX_GROUP_FRAMES = 256
TRIAL_VALUES = 1 << 16
"""Values of the frames, about, on which ways to code a chunk are compared."""

MIN_TRIAL_FRAMES = 33


@dataclass(frozen=True)
class FieldQuantiser:
    """How values of a field become whole numbers.

    Attributes
    ----------
    dtype : numpy.dtype
        Of the values.
    step : float or None
        Twice the largest error of a value, less what rounding to `dtype` adds [units of the field]; None if values
        are exact.
    """

    dtype: np.dtype[Any]
    step: float | None

    @property
    def planes(self) -> int:
        """Whole numbers for each component: exact values of 64 bits have two, the upper and the lower 32 bits."""
        return 2 if self.step is None and self.dtype.itemsize == 8 else 1

    def quantise(self, values: NDArray[Any], fractions: int = 1) -> tuple[Int64Array, Kinds | None]:
        """Turn values (frames, rows, components) into whole numbers, and kinds of numbers (None if all are numbers).

        Parameters
        ----------
        values : array of `dtype`
        fractions : int
            Parts of a step that make a unit; odd.
        """
        if self.step is None:
            return exact_numbers(values), None
        kinds = kinds_of(values)
        numbers = (
            np.asarray(values, np.float64) if kinds is None else np.where(kinds == 0, values, 0).astype(np.float64)
        )
        return np.rint(numbers / (self.step / fractions)).astype(np.int64), kinds

    def restore(self, chunk: _core.FieldChunk) -> NDArray[Any]:
        """Undo `quantise`: return the values of a decoded chunk."""
        if self.step is None:
            return exact_values(chunk.values, self.dtype)
        values = (chunk.values * (self.step / chunk.step)).astype(self.dtype)
        if chunk.kinds is not None:
            for kind, value in enumerate((np.nan, np.inf, -np.inf), start=1):
                values[chunk.kinds == kind] = value
        return values


def field_quantiser(dtype: np.dtype[Any], least: float, most: float, bound: float | None) -> FieldQuantiser:
    """Return how to quantise a field whose finite values lie between `least` and `most`.

    Values are exact if they are no floats, if `bound` is None or 0, or if rounding to `dtype` alone exceeds the bound.

    Parameters
    ----------
    dtype : numpy.dtype
    least, most : float
    bound : float or None
        Largest absolute error.
    """
    if dtype.kind != "f" or not bound:
        return FieldQuantiser(dtype, None)
    largest = max(abs(least), abs(most), float(np.finfo(dtype).tiny))
    step = 2.0 * bound * (1.0 - 2.0**-20) - 2.0 * float(np.spacing(dtype.type(largest / 2)))
    is_fine_enough = step > bound and largest / step * max(one for _, one in CODINGS) < LARGEST_VALUE
    return FieldQuantiser(dtype, step if is_fine_enough else None)


def kinds_of(values: NDArray[Any]) -> Kinds | None:
    """Return the kind of each value, 0 number, 1 not a number, 2 infinity, 3 minus infinity; None if all are 0."""
    if np.isfinite(values).all():
        return None
    return np.select([np.isfinite(values), np.isnan(values), values > 0], [0, 1, 2], 3).astype(np.uint8)


def exact_numbers(values: NDArray[Any]) -> Int64Array:
    """Return whole numbers from which `exact_values` restores the same bits: integers as they are, floats as integers
    in the same order; upper and lower 32 bits of 64 as two components.
    """
    if values.dtype == np.bool_:
        return values.astype(np.int64)
    integers = values
    if values.dtype.kind == "f":
        bits: NDArray[Any] = np.ascontiguousarray(values).view(f"i{values.dtype.itemsize}")
        integers = np.where(bits < 0, np.bitwise_not(bits) ^ np.iinfo(bits.dtype).min, bits)
    if values.dtype.itemsize < 8:
        return integers.astype(np.int64)
    wide = integers.astype(np.int64, casting="unsafe")
    return np.stack([wide >> 32, wide & 0xFFFFFFFF], axis=-1).reshape(*values.shape[:-1], -1)


def exact_values(numbers: Int64Array, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Undo `exact_numbers`."""
    if dtype.itemsize == 8:
        numbers = numbers[..., ::2] << 32 | numbers[..., 1::2] & 0xFFFFFFFF
    if dtype.kind != "f":
        return numbers.astype(dtype, casting="unsafe")
    bits = numbers.astype(f"i{dtype.itemsize}")
    return np.where(bits < 0, np.bitwise_not(bits ^ np.iinfo(bits.dtype).min), bits).view(dtype)


def group_frames(width: int) -> int:
    """Return how many frames of `width` values a group should have."""
    return min(max(GROUP_VALUES // max(width, 1), 1), MAX_GROUP_FRAMES)


def choose_coding(domain: _core.FieldDomain, quantiser: FieldQuantiser, values: NDArray[Any]) -> tuple[int, int]:
    """Return the one of `CODINGS` that makes the first frames of a field smallest.

    Parameters
    ----------
    domain : FieldDomain
    quantiser : FieldQuantiser
    values : array, (frames, rows, components)
        A group of frames.
    """
    width = max(values[0].size, 1)
    trial = values[: max(TRIAL_VALUES // width, MIN_TRIAL_FRAMES)]
    return min(CODINGS, key=lambda coding: (len(encode_chunk(domain, quantiser, trial, coding)), coding))


def encode_chunk(
    domain: _core.FieldDomain, quantiser: FieldQuantiser, values: NDArray[Any], coding: tuple[int, int]
) -> bytes:
    """Encode a group of frames of a field as a chunk of FDAT.

    Parameters
    ----------
    domain : FieldDomain
    quantiser : FieldQuantiser
    values : array, (frames, rows, components)
    coding : (int, int)
        Levels, and fractions of a step, as `choose_coding` finds; exact values take whole steps.
    """
    levels, fractions = coding
    if quantiser.step is None:
        fractions = 1
    numbers, kinds = quantiser.quantise(values, fractions)
    return _core.encode_field_chunk(domain, numbers, kinds, levels, fractions)
