"""Quantised coefficients of a group of frames (section COEF), by the native coder: `core/coefficients/`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pdecodec import _core
from pdecodec.connectivity import core_errors
from pdecodec.spacebasis import SpaceBasis

Int64Array = NDArray[np.int64]

PARTS = 12
"""In which coefficients are decoded: enough for another thread to have work soon, few enough to cost nothing."""


def encode_coefficients(coefficients: Int64Array, basis: SpaceBasis, *, axes: int) -> bytes:
    """Quantised coefficients as bytes; nothing where all are zero.

    Parameters
    ----------
    coefficients : (functions, channels) int64
        Magnitudes 2^40 at most.
    basis : SpaceBasis
    axes : int
        1, or 3 where channels come three by three, one for each axis.
    """
    return _core.encode_coefficients(coefficients, *basis.subbands, axes)


def measure_coefficients(coefficients: Int64Array, basis: SpaceBasis, *, axes: int) -> float:
    """Bits that :func:`encode_coefficients` would take."""
    return _core.measure_coefficients(coefficients, *basis.subbands, axes)


def decode_coefficients(data: bytes, basis: SpaceBasis, channels: int, *, axes: int) -> Int64Array:
    """Undo :func:`encode_coefficients`.

    Parameters
    ----------
    data : bytes
    basis : SpaceBasis
    channels, axes : int

    Returns
    -------
    (functions, channels) int64

    Raises
    ------
    CorruptFileError
        If the bytes are not coefficients of this basis, or not just these.
    """
    coefficients = np.zeros((basis.functions, channels), np.int64)
    for _ in decode_coefficients_in_parts(data, basis, coefficients, axes=axes):
        pass
    return coefficients


def decode_coefficients_in_parts(
    data: bytes, basis: SpaceBasis, coefficients: Int64Array, *, axes: int
) -> Iterator[tuple[int, int]]:
    """As :func:`decode_coefficients`, some elements at a time: others may go on with those while the next are decoded.

    Parameters
    ----------
    data : bytes
    basis : SpaceBasis
    coefficients : (functions, channels) int64, C-contiguous
        All zero; written.
    axes : int

    Yields
    ------
    first, end : int
        Elements whose coefficients are there now; with the first of them those of all nodes.

    Raises
    ------
    CorruptFileError
        As :func:`decode_coefficients`; the coefficients that were there before are then of no use.
    """
    with core_errors():
        decoder = _core.CoefficientDecoder(data, coefficients, *basis.subbands, axes)
        of_nodes = basis.subband_count - basis.element_count
        parts = min(PARTS, basis.element_count)
        for first, end in pairwise(basis.element_count * k // parts for k in range(parts + 1)):
            decoder.decode(of_nodes + end)
            yield first, end
        decoder.finish()
