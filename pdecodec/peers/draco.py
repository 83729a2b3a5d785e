"""Draco, the mesh compressor of glTF, one file a frame."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.peers.grid import Grid
from pdecodec.peers.peer import Encoder, Peer, UnreachableError
from pdecodec.peers.traversal import fans
from pdecodec.sequence import Connectivity, Float32Array

MOST_BITS = 30
"""Of a coordinate, Draco's own limit."""

COMPRESSION_LEVEL = 10

NUMBER_BITS = 12
"""Bits a coordinate has for the number of a vertex: three coordinates name 2**36 vertices."""


class Draco(Peer):
    """Every frame a mesh of its own, by edgebreaker: connectivity is in each of them and counts here.

    Draco returns vertices in an order of its own. It depends on connectivity alone, so the decoder finds it again
    from a mesh whose vertices stand where their numbers say. Where Draco merges or leaves out vertices, frames are
    coded in their original order instead.
    """

    name = "Draco a frame"
    source = "Google, Draco 1.5; Rossignac 1999, Edgebreaker: connectivity compression for triangle meshes"
    package = "DracoPy"

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        import DracoPy

        triangles = _triangles(connectivity)
        keeps_order = _order_of(connectivity) is None
        low = points.reshape(-1, 3).min(axis=0).astype(np.float64)
        extent = float((points.reshape(-1, 3).max(axis=0) - low).max())

        def encode(length: float) -> bytes:
            step = Grid.within(points, length).step
            bits = max(1, math.ceil(math.log2(extent / step + 1.0)))
            if bits > MOST_BITS:
                raise UnreachableError(f"steps of {step:.3g} over {extent:.3g} are more than {MOST_BITS} bits")
            writer = FieldWriter()
            writer.numbers("Q", points.shape[0])
            for frame in points:
                writer.sized(
                    DracoPy.encode(
                        frame.astype(np.float64),
                        triangles,
                        quantization_bits=bits,
                        compression_level=COMPRESSION_LEVEL,
                        quantization_range=step * (2**bits - 1),
                        quantization_origin=low,
                        preserve_order=keeps_order,
                    )
                )
            return writer.to_bytes()

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        import DracoPy

        reader = FieldReader(data, self.name)
        order = _order_of(connectivity)
        points = np.empty((reader.integers("Q")[0], connectivity.vertex_count, 3), np.float32)
        for frame in points:
            found = np.asarray(DracoPy.decode(reader.sized()).points, np.float32)
            frame[slice(None) if order is None else order] = found
        return points


def _triangles(connectivity: Connectivity) -> NDArray[np.uint32] | None:
    return fans(connectivity).astype(np.uint32) if connectivity.face_count else None


def _order_of(connectivity: Connectivity) -> NDArray[np.int64] | None:
    """Vertex that Draco returns at each place; None where it does not return every vertex once."""
    import DracoPy

    triangles = _triangles(connectivity)
    if triangles is None:
        return None
    mask = 2**NUMBER_BITS - 1
    numbers = np.arange(connectivity.vertex_count)
    named = np.stack([numbers >> shift & mask for shift in (0, NUMBER_BITS, 2 * NUMBER_BITS)], axis=1)
    data = DracoPy.encode(
        named.astype(np.float64),
        triangles,
        quantization_bits=NUMBER_BITS,
        quantization_range=float(mask),
        quantization_origin=np.zeros(3),
        compression_level=COMPRESSION_LEVEL,
    )
    found = np.rint(np.asarray(DracoPy.decode(data).points)).astype(np.int64)
    order: NDArray[np.int64] = (found << np.array([0, NUMBER_BITS, 2 * NUMBER_BITS])).sum(axis=1)
    return order if np.array_equal(np.sort(order), numbers) else None
