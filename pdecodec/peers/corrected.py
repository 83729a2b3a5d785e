"""A bound on top of a transform: a coarser transform, and corrections where it misses the bound.

No paper of the peers below has it, but what they are compared with keeps a bound by corrections, so they may as well.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.peers.grid import BELOW_BOUND, CUBE_DIAGONAL
from pdecodec.peers.peer import Encoder, Peer
from pdecodec.peers.symbols import decode_bands, encode_bands
from pdecodec.peers.transform import Transform, rounded
from pdecodec.sequence import Connectivity, Float32Array

COARSER = (1.5, 2.0, 3.0, 4.5)
"""Lengths given to the transform, over the bound; tried in this order until the bytes grow."""


class Corrected(Peer):
    """Another peer with corrections: quantised differences, frame by frame, of the vertices beyond the bound.

    Parameters
    ----------
    transform : Transform
    """

    published = False

    def __init__(self, transform: Transform[Any]) -> None:
        self._transform = transform
        self.name = f"{transform.name}, corrected"
        self.source = transform.source

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        transform = self._transform
        round_to = transform.analyse(points, connectivity)

        def encode(length: float) -> bytes:
            smallest, of_transform, before = b"", b"", 0.0
            for coarser in COARSER:
                rounded_to = round_to(coarser * length)
                levels = _corrections(points, transform.synthesise(rounded_to, connectivity), length)
                corrections = encode_bands(levels.reshape(len(points), -1))
                # A transform's bytes fall less than its length rises: often that tells without coding it.
                least = len(corrections) + len(of_transform) * before / coarser
                if smallest and least >= len(smallest):
                    break
                of_transform, before = transform.write(rounded_to, connectivity), coarser
                writer = FieldWriter()
                writer.numbers("d", _step(length))
                writer.sized(of_transform)
                writer.sized(corrections)
                data = writer.to_bytes()
                if smallest and len(data) >= len(smallest):
                    break
                smallest = data
            return smallest

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        reader = FieldReader(data, self.name)
        (step,) = reader.reals("d")
        points = self._transform.decode(reader.sized(), connectivity)
        levels = decode_bands(reader.sized(), len(points), points[0].size).reshape(points.shape)
        corrected: Float32Array = (points + levels * step).astype(np.float32)
        return corrected

    def version(self) -> str:
        return f"{super().version()}-{self._transform.version()}"


def _step(bound: float) -> float:
    return BELOW_BOUND * CUBE_DIAGONAL * bound


def _corrections(points: Float32Array, decoded: Float32Array, bound: float) -> NDArray[np.int64]:
    """(frames, vertices, 3) int64: zero where the bound holds already."""
    missing = points.astype(np.float64) - decoded
    beyond = np.einsum("fvk,fvk->fv", missing, missing) > bound**2
    levels = np.zeros(points.shape, np.int64)
    levels[beyond] = rounded(missing[beyond], _step(bound))
    return levels
