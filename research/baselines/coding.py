"""Integers to bytes: columns by the predictor with the smallest residuals, and the project's range coder.

A band is coded as zero flag, sign, bit length in unary, then the bits below the leading one; all are adaptive.
Statistics carry over to the next band with less confidence, because bands (modes, frequencies, frames) are ordered
by size. Neighbours are not used, as in the published schemes.
"""

from __future__ import annotations

import numpy as np

from pdecodec import _core
from pdecodec.codec.sections.bytestream import FieldReader, FieldWriter
from pdecodec.mesh.arrays import Int64Array
from pdecodec.research.baselines.traversal import Traversal

HIGHEST_DIFFERENCE = 2
"""Highest order of differences in time that is tried; constant speed has second differences of zero."""


def encode_bands(values: Int64Array) -> bytes:
    """Encode all bands, (bands, numbers) int64 below 2**62 in magnitude."""
    return _core.encode_bands(np.ascontiguousarray(values, np.int64))


def decode_bands(data: bytes, bands: int, numbers: int) -> Int64Array:
    """Decode (bands, numbers) int64 from :func:`encode_bands`."""
    return _core.decode_bands(data, bands, numbers).reshape(bands, numbers)


def encode_over_mesh(values: Int64Array, traversal: Traversal) -> bytes:
    """Encode columns of one number per vertex, (vertices, columns) int64: plain, as differences along the
    traversal, or by parallelogram prediction.
    """
    placed = np.ascontiguousarray(values[traversal.order])
    return _write_columns((placed, np.diff(placed, axis=0, prepend=0), traversal.residuals(placed)))


def decode_over_mesh(data: bytes, columns: int, traversal: Traversal) -> Int64Array:
    """Decode (vertices, columns) int64 from :func:`encode_over_mesh`."""
    kind, residuals = _read_columns(data, columns, traversal.order.size)
    residuals[:, kind == 1] = np.cumsum(residuals[:, kind == 1], axis=0)
    residuals[:, kind == 2] = traversal.restored(residuals[:, kind == 2])
    values = np.empty_like(residuals)
    values[traversal.order] = residuals
    return values


def encode_over_time(values: Int64Array) -> bytes:
    """Encode columns of one number per frame, (frames, columns) int64: plain, or as first or second differences."""
    candidates = [np.ascontiguousarray(values)]
    for _ in range(HIGHEST_DIFFERENCE):
        candidates.append(np.diff(candidates[-1], axis=0, prepend=0))
    return _write_columns(tuple(candidates))


def decode_over_time(data: bytes, columns: int, frames: int) -> Int64Array:
    """Decode (frames, columns) int64 from :func:`encode_over_time`."""
    order, values = _read_columns(data, columns, frames)
    for least in range(1, HIGHEST_DIFFERENCE + 1):
        values[:, order >= least] = np.cumsum(values[:, order >= least], axis=0)
    return values


def _write_columns(candidates: tuple[Int64Array, ...]) -> bytes:
    """Write for each column, (rows, columns), whichever candidate takes fewest bits: its index, and its values
    as a band.
    """
    bits = [np.log2(1.0 + np.abs(candidate)).sum(axis=0) for candidate in candidates]
    kind = np.argmin(bits, axis=0)
    writer = FieldWriter()
    writer.sized(encode_bands(kind[None, :]))
    writer.sized(encode_bands(np.choose(kind, candidates).T))
    return writer.to_bytes()


def _read_columns(data: bytes, columns: int, rows: int) -> tuple[Int64Array, Int64Array]:
    reader = FieldReader(data, "columns")
    kind = decode_bands(reader.sized(), 1, columns)[0]
    return kind, np.ascontiguousarray(decode_bands(reader.sized(), columns, rows).T)
