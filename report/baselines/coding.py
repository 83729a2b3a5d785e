"""Integers to bytes: columns by the predictor that leaves the smallest residuals, and the project's range coder.

A band is coded as zero flag, sign, bit length in unary, then the bits below the leading one: all adaptive. What was
learned is carried to the next band but trusted less, since bands (modes, frequencies, frames) follow one another by
size. No neighbours are looked at: that is what the published schemes do.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.kernels.rangecoder import COUNT_MASK, ENCODE, EVEN, code_bit, finish, new_coder, new_decoder
from pdecodec.report.baselines.traversal import Traversal

Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

ZERO, SIGN, LENGTH = 0, 1, 2
"""Adaptive bit models of the zero flag, of the sign, and the first of the bit lengths."""

MOST_LENGTH = 62
"""Bits of the largest magnitude."""

MANTISSA = LENGTH + MOST_LENGTH
"""First model of the bits below the leading one, :data:`PER_LENGTH` for each bit length."""

TREE_BITS = 2
"""Bits below the leading one that are coded given those before them; the rest are close to even."""

PER_LENGTH = MOST_LENGTH + (1 << TREE_BITS)

MODELS = MANTISSA + (MOST_LENGTH + 1) * PER_LENGTH

TRUSTED = 24
"""Adaptations that a model is taken to have seen at the start of the next band."""

HIGHEST_DIFFERENCE = 2
"""Order of the differences in time that are tried: what moves at constant speed leaves nothing of the second."""


@njit(cache=True)
def code_number(coder: Int64Array, data: UInt8Array, models: Int64Array, value: int) -> int:
    """Code one integer below 2**62 in magnitude; returns it (what was given does not matter when decoding)."""
    if code_bit(coder, data, models, ZERO, 1 if value == 0 else 0):
        return 0
    negative = code_bit(coder, data, models, SIGN, 1 if value < 0 else 0)
    size = abs(value)
    length = 1
    while length < MOST_LENGTH and code_bit(coder, data, models, LENGTH + length, 1 if size >> length else 0):
        length += 1
    magnitude = 1
    for position in range(length - 2, -1, -1):
        within = magnitude if magnitude < (1 << TREE_BITS) else (1 << TREE_BITS) + position
        model = MANTISSA + length * PER_LENGTH + within
        magnitude = (magnitude << 1) | code_bit(coder, data, models, model, (size >> position) & 1)
    return -magnitude if negative else magnitude


@njit(cache=True)
def code_bands(coder: Int64Array, data: UInt8Array, models: Int64Array, values: Int64Array) -> None:
    """Code (bands, numbers) int64 in order; overwritten when decoding. `models` are (MODELS,) int64 and adapt."""
    for band in range(values.shape[0]):
        for model in range(models.size):
            count = models[model] & COUNT_MASK
            models[model] -= max(0, count - TRUSTED)
        for k in range(values.shape[1]):
            values[band, k] = code_number(coder, data, models, values[band, k])


def encode_bands(values: Int64Array) -> bytes:
    """Bytes of all bands, (bands, numbers) int64 below 2**62 in magnitude."""
    bands = np.array(values, dtype=np.int64, order="C")
    room = 64 + 2 * bands.size
    while True:
        coder, data = new_coder(ENCODE), np.zeros(room, np.uint8)
        code_bands(coder, data, np.full(MODELS, EVEN), bands)
        used = finish(coder, data)
        if used <= room:
            return data[:used].tobytes()
        room = used


def decode_bands(data: bytes, bands: int, numbers: int) -> Int64Array:
    """(bands, numbers) int64 from :func:`encode_bands`."""
    values = np.zeros((bands, numbers), np.int64)
    content = np.frombuffer(data, np.uint8).copy()  # the coder's one form writes as well
    code_bands(new_decoder(content), content, np.full(MODELS, EVEN), values)
    return values


def encode_over_mesh(values: Int64Array, traversal: Traversal) -> bytes:
    """Columns of one number a vertex, (vertices, columns) int64, each as it is, as differences along the traversal, or
    by parallelograms.
    """
    placed = np.ascontiguousarray(values[traversal.order])
    return _write_columns((placed, np.diff(placed, axis=0, prepend=0), traversal.residuals(placed)))


def decode_over_mesh(data: bytes, columns: int, traversal: Traversal) -> Int64Array:
    """(vertices, columns) int64 from :func:`encode_over_mesh`."""
    kind, residuals = _read_columns(data, columns, traversal.order.size)
    residuals[:, kind == 1] = np.cumsum(residuals[:, kind == 1], axis=0)
    residuals[:, kind == 2] = traversal.restored(residuals[:, kind == 2])
    values = np.empty_like(residuals)
    values[traversal.order] = residuals
    return values


def encode_over_time(values: Int64Array) -> bytes:
    """Columns of a number a frame, (frames, columns) int64, as they are or as first or second differences."""
    candidates = [np.ascontiguousarray(values)]
    for _ in range(HIGHEST_DIFFERENCE):
        candidates.append(np.diff(candidates[-1], axis=0, prepend=0))
    return _write_columns(tuple(candidates))


def decode_over_time(data: bytes, columns: int, frames: int) -> Int64Array:
    """(frames, columns) int64 from :func:`encode_over_time`."""
    order, values = _read_columns(data, columns, frames)
    for least in range(1, HIGHEST_DIFFERENCE + 1):
        values[:, order >= least] = np.cumsum(values[:, order >= least], axis=0)
    return values


@njit(cache=True)
def cheapest_columns(candidates: tuple[Int64Array, ...]) -> tuple[Int64Array, Int64Array]:
    """Which of the candidates, (rows, columns), has the fewest bits in each column; and those columns, as bands."""
    rows, columns = candidates[0].shape
    bits = np.zeros((len(candidates), columns))
    for number in range(len(candidates)):
        candidate = candidates[number]
        for i in range(rows):
            for k in range(columns):
                bits[number, k] += np.log2(1.0 + abs(candidate[i, k]))
    kind = np.empty(columns, np.int64)
    for k in range(columns):
        kind[k] = bits[:, k].argmin()
    bands = np.empty((columns, rows), np.int64)
    for i in range(rows):
        for k in range(columns):
            bands[k, i] = candidates[kind[k]][i, k]
    return kind, bands


def _write_columns(candidates: tuple[Int64Array, ...]) -> bytes:
    kind, bands = cheapest_columns(candidates)
    writer = FieldWriter()
    writer.sized(encode_bands(kind[None, :]))
    writer.sized(encode_bands(bands))
    return writer.to_bytes()


def _read_columns(data: bytes, columns: int, rows: int) -> tuple[Int64Array, Int64Array]:
    reader = FieldReader(data, "columns")
    kind = decode_bands(reader.sized(), 1, columns)[0]
    return kind, np.ascontiguousarray(decode_bands(reader.sized(), columns, rows).T)
