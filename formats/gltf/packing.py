"""Compress rows of glTF files with meshoptimizer (extra ``gltf``), and round them as its filters do.

A filter keeps rows in a form that compresses better; viewers decode it. The forms are computed here, without
meshoptimizer's own encoders, and come with the values that viewers see.
"""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import MissingExtraError
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array

MESHOPT_VERTEX_VERSION, MESHOPT_STRIDE = 0, 256
"""Version of meshoptimizer's vertex codec that the extension prescribes, and its longest rows [bytes]."""

MANTISSA_BITS, EXPONENT_RANGE = 23, (-100, 100)
"""Bits without the sign, and exponents, that meshoptimizer's exponential filter can hold."""

TURN_BITS = range(5, 17)
"""Bits of a component that meshoptimizer's filter for quaternions is tried with."""

TRIANGLE_ORDERS = 2
"""Number of ways to order triangles."""

LARGEST_FRACTION = {kind: np.iinfo(kind).max for kind in (np.int8, np.int16)}
"""The integers that stand for 1 in normalised accessors."""

Coded = tuple[str, NDArray[Any]]
"""A filter of meshoptimizer, and rows in its form."""

_SMALLEST_DIVISOR = float(np.finfo(np.float64).tiny)


class Packer:
    """The encoders of meshoptimizer.

    Raises
    ------
    MissingExtraError
        If meshoptimizer is not installed.
    """

    def __init__(self) -> None:
        try:
            self._encoder: Any = importlib.import_module("meshoptimizer")
        except ModuleNotFoundError as error:
            raise MissingExtraError(
                "compression of glTF needs the package meshoptimizer; run: pip install 'pdecodec[gltf]'"
            ) from error
        self._encoder.encode_vertex_version(MESHOPT_VERTEX_VERSION)

    def pack(self, data: NDArray[Any], *, triangles: bool) -> tuple[str, bytes] | None:
        """Return the mode and bytes of compressed rows, (n,) or (n, k); None if that does not make them smaller.

        If `triangles` is true, the order of each triangle's corners may be rotated.
        """
        found: bytes
        if not data.size:
            return None
        stride = data.nbytes // len(data)
        if triangles:
            mode, found = "TRIANGLES", self._encoder.encode_index_buffer(data.astype(np.uint32))
        elif data.ndim == 1 and data.dtype.kind == "u" and stride in (2, 4):
            mode, found = self.numbering(data)
        elif stride % 4 == 0 and stride <= MESHOPT_STRIDE:
            mode, found = "ATTRIBUTES", self.rows(data)
        else:
            return None
        return (mode, found) if len(found) < data.nbytes else None

    def numbering(self, numbers: NDArray[np.unsignedinteger]) -> tuple[str, bytes]:
        """Return the mode that numbers (n,) take fewest bytes in, and the bytes; those of 16 bits have one mode."""
        found: bytes = self._encoder.encode_index_sequence(numbers.astype(np.uint32))
        rows = self.rows(numbers) if numbers.itemsize == 4 else found
        return ("ATTRIBUTES", rows) if len(rows) < len(found) else ("INDICES", found)

    def rows(self, data: NDArray[Any]) -> bytes:
        """Return compressed rows, (n,) or (n, k)."""
        found: bytes = self._encoder.encode_vertex_buffer(data, len(data), data.nbytes // len(data))
        return found

    def triangle_order(self, triangles: Int64Array, count: int, way: int) -> Int64Array:
        """Return an order (n,) of triangles (n, 3) of `count` vertices that may compress better than theirs.

        `way` numbers the ways to find one, up to :data:`TRIANGLE_ORDERS`.
        """
        flat = np.ascontiguousarray(triangles.reshape(-1), np.uint32)
        found = np.zeros_like(flat)
        optimize = (self._encoder.optimize_vertex_cache_strip, self._encoder.optimize_vertex_cache)[way]
        optimize(found, flat, flat.size, count)
        order = np.empty(len(triangles), np.int64)
        # Equal triangles may stand for each other.
        order[_ranked(found.reshape(-1, 3))] = _ranked(triangles)
        return order


def _ranked(triangles: NDArray[np.integer]) -> Int64Array:
    """Return the numbers of triangles (n, 3) in the order of their vertices, however their corners are rotated."""
    return np.lexsort(np.sort(triangles, axis=1).T)


def exponential(rows: Float32Array, step: float) -> tuple[Float32Array, Coded | None]:
    """Round rows (n, k) to multiples of the power of two at or below `step`; return them and their form.

    If these need too many digits, return the rows as they are, and None.
    """
    needed = math.frexp(float(np.abs(rows).max()))[1] - MANTISSA_BITS + 1
    exponent = min(math.frexp(step)[1] - 1, EXPONENT_RANGE[1])
    if exponent < max(needed, EXPONENT_RANGE[0]):
        return rows, None
    wholes = np.rint(np.ldexp(rows.astype(np.float64), -exponent)).astype(np.int32)
    coded = np.uint32((exponent & 0xFF) << 24) | (wholes & 0xFFFFFF).astype("<u4")
    return np.ldexp(wholes.astype(np.float64), exponent).astype(np.float32), ("EXPONENTIAL", coded)


def octahedral(normals: Float32Array) -> tuple[Float64Array, Coded]:
    """Round unit vectors (n, 3) to points of an octahedron, of 8 bits; return them and their form."""
    most = LARGEST_FRACTION[np.int8]
    rows = normals.astype(np.float64)
    x, y, z = (rows / np.maximum(np.abs(rows).sum(axis=1, keepdims=True), _SMALLEST_DIVISOR)).T
    coded = np.zeros((len(rows), 4), np.int8)
    coded[:, :2], coded[:, 2] = np.rint(np.stack(_folded(x, y, z), axis=1) * most), most
    x, y = coded[:, :2].T / most
    z = 1 - np.abs(x) - np.abs(y)
    found = np.stack([*_folded(x, y, z), z], axis=1)
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    return np.rint(found * most) / most, ("OCTAHEDRAL", coded)


def _folded(x: Float64Array, y: Float64Array, z: Float64Array) -> list[Float64Array]:
    """Return x and y of points on an octahedron, with its lower half turned outwards or back."""
    return [np.where(z < 0, np.where(a < 0, -1, 1) * (1 - np.abs(b)), a) for a, b in ((x, y), (y, x))]


def quaternions(turns: Float32Array, largest_angle: float) -> tuple[Float64Array, Coded] | None:
    """Round unit quaternions (n, 4) to the fewest bits that turn nothing by more than an angle [radians].

    Return them as viewers see them and their form; None if no number of bits is enough. A quaternion and its negative
    are the same turn.
    """
    most, exact = LARGEST_FRACTION[np.int16], turns.astype(np.float64)
    largest = np.abs(exact).argmax(axis=1)
    every = np.arange(len(exact))
    others = (largest[:, None] + np.arange(1, 4)) % 4
    exact *= np.where(exact[every, largest] < 0, -1, 1)[:, None]
    small = exact[every[:, None], others] * math.sqrt(2)
    for bits in TURN_BITS:
        unit = (1 << (bits - 1)) - 1
        coded = np.empty((len(exact), 4), "<i2")
        coded[:, :3], coded[:, 3] = np.rint(np.clip(small, -1, 1) * unit), (unit & ~3) | largest
        found = np.empty_like(exact)
        found[every[:, None], others] = part = coded[:, :3] / (unit * math.sqrt(2))
        found[every, largest] = np.sqrt(np.maximum(0, 1 - (part * part).sum(axis=1)))
        found = np.rint(found * most) / most
        # A turn is twice the angle between quaternions.
        if 2 * float(np.linalg.norm(found - exact, axis=1).max(initial=0)) <= largest_angle:
            return found, ("QUATERNION", coded)
    return None
