"""Quantise fields to whole numbers, and choose the coding of their chunks (section FDAT).

A measured field is stored in steps of twice its bound, or in fractions of a step where its predictions are finer. An
exact field (integers, booleans, floats whose bits must be restored) is stored unquantised. Coder:
`core/sections/fields/`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec import _core
from pdecodec.mesh.arrays import Int64Array
from pdecodec.system.shares import thread_count

Kinds = NDArray[np.uint8]

LARGEST_VALUE = 2**36
"""Largest magnitude of a whole number in a chunk."""


class FieldCoding(NamedTuple):
    """One way to code the chunks of a field.

    Attributes
    ----------
    levels : int
        Every 2^levels-th frame is coded first.
    fractions : int
        Number of units per step; odd.
    left_over : float
        Root mean square of the remainder that functions of time leave [bounds]; 0 without functions of time.
    """

    levels: int
    fractions: int
    left_over: float = 0.0


PREDICTIONS = (FieldCoding(0, 1), FieldCoding(1, 1), FieldCoding(6, 15))
"""Predictions that an encoder tries. Without the third one, smooth fields cost up to three times as much."""

TRANSFORMS = (FieldCoding(6, 15, 1.0), FieldCoding(6, 15, 0.5), FieldCoding(6, 15, 0.25))
"""Transforms that an encoder tries for fields of few functions of time."""

MAX_FUNCTIONS = 64
MAX_COEFFICIENT_DIGITS = 22
MAX_FUNCTION_SHARE = 1 / 6
"""Largest number of functions of time that is tried, as a share of the frames or of the values of a frame."""

GROUP_VALUES = 1 << 20
"""Approximate number of values in a group of frames: as many as are decoded in a tenth of a second."""

MAX_GROUP_FRAMES = 512
TRIAL_VALUES = 1 << 13
"""Approximate number of values on which predictions are compared."""

TRIAL_FRAMES = 96
TRIAL_PARTS = 4
"""Parts of the rows from which the values of a trial are taken."""

TRANSFORM_TRIAL_VALUES = 1 << 15
"""Approximate number of values on which transforms are compared: all frames of a group, of some rows."""


@dataclass(frozen=True)
class FieldQuantiser:
    """Quantiser that turns values of a field into whole numbers.

    Attributes
    ----------
    dtype : numpy.dtype
        Type of the values.
    step : float or None
        Twice the largest error of a value, less the rounding error of `dtype` [units of the field]; None if values are
        exact.
    """

    dtype: np.dtype[Any]
    step: float | None

    @property
    def planes(self) -> int:
        """Number of whole numbers per component: exact values of 64 bits have two, the upper and the lower 32 bits."""
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
    """Return the quantiser of a field whose finite values lie between `least` and `most`.

    Values are exact if they are not floats, if `bound` is None or 0, or if rounding to `dtype` alone exceeds the
    bound.

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
    is_fine_enough = step > bound and largest / step * max(one.fractions for one in PREDICTIONS) < LARGEST_VALUE
    return FieldQuantiser(dtype, step if is_fine_enough else None)


def kinds_of(values: NDArray[Any]) -> Kinds | None:
    """Return the kind of each value, 0 number, 1 not a number, 2 infinity, 3 minus infinity; None if all are 0."""
    if np.isfinite(values).all():
        return None
    return np.select([np.isfinite(values), np.isnan(values), values > 0], [0, 1, 2], 3).astype(np.uint8)


def exact_numbers(values: NDArray[Any]) -> Int64Array:
    """Return whole numbers from which `exact_values` restores the same bits: integers unchanged, floats as
    integers in the same order; numbers of 64 bits as two components, upper and lower 32 bits.
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


def group_frames(frames: int, width: int) -> int:
    """Return how many frames a group should have, for a field of `frames` frames with `width` values each."""
    most = min(max(GROUP_VALUES // max(width, 1), 1), MAX_GROUP_FRAMES)
    return -(-frames // -(-frames // most))


def choose_coding(
    rows: _core.FieldRows, quantiser: FieldQuantiser, values: NDArray[Any]
) -> tuple[FieldCoding, Spectrum | None]:
    """Return the coding with the smallest chunk for a sample of a field, and the spectrum of `values` if it uses one.

    Parameters
    ----------
    rows : FieldRows
    quantiser : FieldQuantiser
    values : array, (frames, rows, components)
        A group of frames.
    """
    predictions = [one for one in PREDICTIONS if quantiser.step is not None or one.fractions == 1]
    some, chosen = some_rows(rows, TRIAL_VALUES // (min(len(values), TRIAL_FRAMES) * values.shape[2]))
    sample = values[:TRIAL_FRAMES, chosen]
    best = min(predictions, key=lambda coding: len(encode_chunk(some, quantiser, sample, coding)))
    if quantiser.step is None or kinds_of(values) is not None:
        return best, None
    numbers = quantiser.quantise(values, TRANSFORMS[0].fractions)[0]
    whole = spectrum(numbers)
    counts = [function_count(whole, coding) for coding in TRANSFORMS]
    if counts[0] is None:
        return best, None
    some, chosen = some_rows(rows, TRANSFORM_TRIAL_VALUES // values[:, 0].size)
    least = float(len(encode_chunk(some, quantiser, values[:, chosen], best)))
    motion = Spectrum(whole.rows.reshape(*values.shape[1:], -1)[chosen].reshape(-1, len(values)), whole.functions)
    for coding, count in zip(TRANSFORMS, counts, strict=True):
        if count is None:
            break
        data = encode_transformed(some, numbers[:, chosen], motion, count, coding)
        of_time = int.from_bytes(
            data[2 + count : 6 + count], "little"
        )  # Bytes of the functions of time, which do not depend on the number of rows.
        size = len(data) - of_time * (1.0 - some.count / rows.count)
        if size < least:
            best, least = coding, size
    return best, whole if best.left_over else None


def some_rows(rows: _core.FieldRows, count: int) -> tuple[_core.FieldRows, Int64Array]:
    """Return about `count` rows, in a few blocks spread over all of them, and their numbers."""
    part = max(count // TRIAL_PARTS, 1)
    starts = np.linspace(0, rows.count, TRIAL_PARTS, endpoint=False).astype(np.int64)
    chosen = np.unique(starts[:, None] + np.arange(min(part, -(-rows.count // TRIAL_PARTS))))
    chosen = chosen[chosen < rows.count]
    return rows.some(chosen), chosen


class Spectrum(NamedTuple):
    """Rows of a field (values of a frame, frames), and the functions of time that hold most of their energy, the
    greatest first.
    """

    rows: NDArray[np.float64]
    functions: _core.Eigen


def spectrum(numbers: Int64Array) -> Spectrum:
    """Decompose whole numbers (frames, rows, components) into functions of time."""
    rows = np.ascontiguousarray(numbers.reshape(len(numbers), -1).T, np.float64)
    energy = _core.sums_of_squares(rows, False, thread_count())
    return Spectrum(rows, _core.symmetric_eigen(energy, True, thread_count()))


def function_count(motion: Spectrum, coding: FieldCoding) -> int | None:
    """Return the number of functions of time after which the remainder is within the limit of `coding`; None if
    there are too many, or a function exceeds the format's largest number.
    """
    size = motion.rows.size
    allowed = size * (coding.left_over * coding.fractions / 2.0) ** 2
    most = min(int(min(motion.rows.shape) * MAX_FUNCTION_SHARE), MAX_FUNCTIONS)
    left = np.cumsum(np.maximum(motion.functions.values, 0.0)[::-1])[::-1]
    counts = np.flatnonzero(left[: most + 1] <= allowed)
    if not len(counts) or counts[0] == 0:
        return None
    count = int(counts[0])
    # A function is at most as large as the values times the root of the frames.
    may_exceed = np.abs(motion.rows).max() * math.sqrt(motion.rows.shape[1]) >= LARGEST_VALUE
    return None if may_exceed and np.abs(_scaled_functions(motion, count)[0]).max() > LARGEST_VALUE else count


def encode_chunk(
    rows: _core.FieldRows,
    quantiser: FieldQuantiser,
    values: NDArray[Any],
    coding: FieldCoding,
    motion: Spectrum | None = None,
) -> bytes:
    """Encode a group of frames of a field as a chunk of FDAT.

    Parameters
    ----------
    rows : FieldRows
    quantiser : FieldQuantiser
    values : array, (frames, rows, components)
    coding : FieldCoding
        As `choose_coding` returns it; if its functions of time do not suit this group, the group is predicted instead.
    motion : Spectrum, optional
        Functions of time of `values`, from `choose_coding`.
    """
    numbers, kinds = quantiser.quantise(values, coding.fractions)
    if coding.left_over > 0.0 and kinds is None:
        motion = motion or spectrum(numbers)
        count = function_count(motion, coding)
        if count is not None:
            return encode_transformed(rows, numbers, motion, count, coding)
    return _core.encode_field_chunk(rows, numbers, kinds, coding.levels, coding.fractions)


def _scaled_functions(motion: Spectrum, count: int) -> tuple[Int64Array, NDArray[np.float64]]:
    """Return the first functions of time (functions, frames), scaled so that the largest coefficient of each is
    1 or -1, and the coefficients (values of a frame, functions).
    """
    directions = np.ascontiguousarray(motion.functions.vectors[:count])
    projected = _core.multiply_rows(motion.rows, np.ascontiguousarray(directions.T), 1, thread_count())
    largest = np.maximum(np.abs(projected).max(axis=0), 1.0)
    return np.rint(directions * largest[:, None]).astype(np.int64), projected / largest


def encode_transformed(
    rows: _core.FieldRows, numbers: Int64Array, motion: Spectrum, count: int, coding: FieldCoding
) -> bytes:
    """Encode whole numbers by `count` functions of time, their coefficients and a remainder."""
    functions, shares = _scaled_functions(motion, count)
    sizes = np.abs(functions).max(axis=1)
    digits = np.array([min(int(size).bit_length(), MAX_COEFFICIENT_DIGITS + 1) - 1 for size in sizes]).clip(0)
    coefficients = np.rint(shares * 2.0**digits).astype(np.int64)
    return _core.encode_transformed_field_chunk(
        rows,
        numbers,
        np.ascontiguousarray(functions.T)[:, None, :],
        coefficients.reshape(*numbers.shape[1:], count),
        digits.astype(np.uint8),
        coding.levels,
        coding.fractions,
    )


def float_error(values: NDArray[Any], decoded: NDArray[Any]) -> float:
    """Return the largest error of decoded floats; infinity if one value is not finite and its counterpart differs."""
    if values.size == 0:
        return 0.0
    finite = np.isfinite(values)
    with np.errstate(over="ignore"):  # beyond the largest float: the error is infinite
        if finite.all():
            return float(np.abs(decoded.astype(np.float64) - values).max())
        if not np.array_equal(values[~finite], decoded[~finite], equal_nan=True):
            return math.inf
        return float(np.abs(decoded[finite].astype(np.float64) - values[finite]).max(initial=0.0))
