"""Quantised coefficients of a group of frames (section COEF), by the native coder: `core/sections/coefficients/`."""

from __future__ import annotations

from pdecodec import _core
from pdecodec.codec.sections.space_basis import SpaceBasis
from pdecodec.mesh.arrays import Int64Array


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
