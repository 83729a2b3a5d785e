"""Columns of integers to bytes, each with the predictor that leaves it the smallest residuals."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.peers.symbols import decode_bands, encode_bands
from pdecodec.peers.traversal import Traversal

Int64Array = NDArray[np.int64]

HIGHEST_DIFFERENCE = 2
"""Order of the differences in time that are tried: what moves at constant speed leaves nothing of the second."""


def encode_over_mesh(values: Int64Array, traversal: Traversal) -> bytes:
    """Columns of one number a vertex: as they are, as differences along the traversal, or by parallelograms.

    Parameters
    ----------
    values : (vertices, columns) int64
    traversal : Traversal
    """
    placed = values[traversal.order]
    differences = np.diff(placed, axis=0, prepend=0)
    return _write_columns((placed, differences, placed - traversal.predicted(placed)))


def decode_over_mesh(data: bytes, columns: int, traversal: Traversal) -> Int64Array:
    """(vertices, columns) int64 from :func:`encode_over_mesh`."""
    kind, residuals = _read_columns(data, columns, traversal.order.size)
    residuals[:, kind == 1] = np.cumsum(residuals[:, kind == 1], axis=0)
    residuals[:, kind == 2] = traversal.restored(residuals[:, kind == 2])
    values = np.empty_like(residuals)
    values[traversal.order] = residuals
    return values


def encode_over_time(values: Int64Array) -> bytes:
    """Columns of one number a frame, as they are or as differences of the first or second order.

    Parameters
    ----------
    values : (frames, columns) int64
    """
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
    """Of each column the candidate whose numbers have the fewest bits.

    Parameters
    ----------
    candidates : tuple of (rows, columns) int64

    Returns
    -------
    kind : (columns,) int64
        Which of the candidates.
    bands : (columns, rows) int64
    """
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


def cheapest_columns_reference(candidates: tuple[Int64Array, ...]) -> tuple[Int64Array, Int64Array]:
    """Plain form of :func:`cheapest_columns`."""
    bits = np.stack([np.log2(1.0 + np.abs(each)).sum(axis=0) for each in candidates])
    kind = bits.argmin(axis=0)
    return kind, np.take_along_axis(np.stack(candidates), kind[None, None, :], axis=0)[0].T


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
