"""Adaptive coding of a group's coefficient levels."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import CorruptFileError
from pdecodec.spacebasis import SpaceBasis

Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

FIRST_BYTES = 4096
"""Room for a chunk at first; it doubles until it is enough."""

PARTS = 12
"""In which levels are decoded: enough for another thread to have work soon, few enough to cost nothing."""

FIRST_WEIGHT = 0.3
"""Of each opinion in a mix, before anything is learnt."""


class _Model:
    """What the coder of levels has learnt on the way through the runs of a basis."""

    def __init__(self, basis: SpaceBasis, axes: int) -> None:
        from pdecodec.kernels import level_model as model
        from pdecodec.kernels.rangecoder import EVEN

        self._units, self._axes = basis.subbands, axes
        self._cells = np.full(model.CELLS, EVEN, np.int64)
        self._weights = np.full((model.MIXERS, model.MIXED), round(FIRST_WEIGHT * 65536), np.int64)
        self._counts = np.zeros((2, model.ZONES), np.int64)
        self._latest = np.full(2, -1, np.int64)

    def code(self, first: int, end: int, coder: Int64Array, data: UInt8Array, levels: Int64Array) -> bool:
        """Code the runs `first` to `end` - 1; False where the bytes are not such levels."""
        from pdecodec.kernels.level_model import code_levels

        learnt = self._cells, self._weights, self._counts, self._latest
        return bool(code_levels(first, end, coder, data, levels, *self._units, self._axes, *learnt))


def _code(mode: int, data: UInt8Array, levels: Int64Array, basis: SpaceBasis, axes: int) -> Int64Array:
    """Encode or measure; the coder."""
    from pdecodec.kernels.rangecoder import new_coder

    coder = new_coder(mode)
    _Model(basis, axes).code(0, basis.subband_count, coder, data, levels)
    return coder


def encode_levels(levels: Int64Array, basis: SpaceBasis, *, axes: int) -> bytes:
    """Levels as bytes; nothing where all are zero.

    Parameters
    ----------
    levels : (columns, width) int64
    basis : SpaceBasis
    axes : int
        1, or 3 where functions of time come three by three, one for each axis.
    """
    from pdecodec.kernels.rangecoder import ENCODE, finish

    if not levels.any():
        return b""
    room = FIRST_BYTES
    while True:
        data = np.zeros(room, np.uint8)
        coder = _code(ENCODE, data, levels, basis, axes)
        size = finish(coder, data)
        if size <= room:
            return data[:size].tobytes()
        room = size


def measure_levels(levels: Int64Array, basis: SpaceBasis, *, axes: int) -> float:
    """Bits that :func:`encode_levels` would take."""
    from pdecodec.kernels.rangecoder import COST, COST_BITS, MEASURE

    coder = _code(MEASURE, np.zeros(1, np.uint8), levels, basis, axes)
    return float(coder[COST]) / 2.0**COST_BITS


def decode_levels(data: bytes, basis: SpaceBasis, width: int, *, axes: int) -> Int64Array:
    """Undo :func:`encode_levels`.

    Raises
    ------
    CorruptFileError
        If the bytes are not levels of this basis, or not just these.
    """
    levels = np.zeros((basis.functions, width), np.int64)
    for _ in decode_levels_in_parts(data, basis, levels, axes=axes):
        pass
    return levels


def decode_levels_in_parts(
    data: bytes, basis: SpaceBasis, levels: Int64Array, *, axes: int
) -> Iterator[tuple[int, int]]:
    """As :func:`decode_levels`, some patches at a time: others may go on with those while the next are decoded.

    Parameters
    ----------
    data : bytes
    basis : SpaceBasis
    levels : (columns, width) int64
        All zero; written.
    axes : int

    Yields
    ------
    first, end : int
        Patches whose levels are there now; with the first of them those of all sets.

    Raises
    ------
    CorruptFileError
        As :func:`decode_levels`; the levels that were there before are then of no use.
    """
    from pdecodec.kernels.rangecoder import is_finished, new_decoder

    model, sets = _Model(basis, axes), basis.subband_count - basis.element_count
    coded = np.frombuffer(bytearray(data), np.uint8)
    coder = new_decoder(coded)
    parts = min(PARTS, basis.element_count)
    for first, end in pairwise(basis.element_count * k // parts for k in range(parts + 1)):
        begin = sets + first if first else 0
        if data and not model.code(begin, sets + end, coder, coded, levels):
            raise CorruptFileError("section COEF holds levels that cannot be; get the file again")
        yield first, end
    if data and not is_finished(coder, coded):
        raise CorruptFileError("section COEF does not end where its levels do; get the file again")
