"""Adaptive coding of a group's coefficient levels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import CorruptFileError
from pdecodec.quantise import LARGEST
from pdecodec.spacebasis import SpaceBasis

Int64Array = NDArray[np.int64]

FIRST_BYTES = 4096
"""Room for a chunk at first; it doubles until it is enough."""

FIRST_WEIGHT = 0.3
"""Of each opinion in a mix, before anything is learnt."""


def _code(
    mode: int, data: NDArray[np.uint8], levels: Int64Array, basis: SpaceBasis, axes: int
) -> tuple[Int64Array, bool]:
    from pdecodec.kernels import level_model as model
    from pdecodec.kernels.rangecoder import DECODE, EVEN, new_coder, new_decoder

    coder = new_decoder(data) if mode == DECODE else new_coder(mode)
    cells = np.full(model.CELLS, EVEN, np.int64)
    weights = np.full((model.MIXERS, model.MIXED), round(FIRST_WEIGHT * 65536), np.int64)
    counts = np.zeros((2, model.ZONES), np.int64)
    sound = model.code_levels(coder, data, levels, *basis.units, axes, cells, weights, counts)
    return coder, sound


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
        coder, _ = _code(ENCODE, data, levels, basis, axes)
        size = finish(coder, data)
        if size <= room:
            return data[:size].tobytes()
        room = size


def measure_levels(levels: Int64Array, basis: SpaceBasis, *, axes: int) -> float:
    """Bits that :func:`encode_levels` would take."""
    from pdecodec.kernels.rangecoder import COST, COST_BITS, MEASURE

    coder, _ = _code(MEASURE, np.zeros(1, np.uint8), levels, basis, axes)
    return float(coder[COST]) / 2.0**COST_BITS


def decode_levels(data: bytes, basis: SpaceBasis, width: int, *, axes: int) -> Int64Array:
    """Undo :func:`encode_levels`.

    Raises
    ------
    CorruptFileError
        If the bytes are not levels of this basis, or not just these.
    """
    from pdecodec.kernels.rangecoder import DECODE, is_finished

    levels = np.zeros((basis.columns, width), np.int64)
    if data:
        coded = np.frombuffer(bytearray(data), np.uint8)
        coder, sound = _code(DECODE, coded, levels, basis, axes)
        if not sound:
            raise CorruptFileError("section COEF holds levels that cannot be; get the file again")
        if not is_finished(coder, coded):
            raise CorruptFileError("section COEF does not end where its levels do; get the file again")
        if max(int(levels.max(initial=0)), -int(levels.min(initial=0))) > LARGEST:
            raise CorruptFileError("section COEF has a coefficient out of range")
    return levels
