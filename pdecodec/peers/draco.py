"""Draco, the mesh compressor of glTF, one file a frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.peers.grid import Grid
from pdecodec.peers.peer import Encoder, Peer, UnreachableError
from pdecodec.peers.traversal import fans
from pdecodec.sequence import Connectivity, Float32Array, Float64Array

MOST_BITS = 24
"""Of a coordinate. Draco allows 30 but computes in float32; finer ones only take it long."""

COMPRESSION_LEVEL = 10
"""The strongest. Draco's default, 7, is three times as fast and takes 3 to 13 % more bytes."""

NUMBER_BITS = 12
"""Bits a coordinate has for the number of a vertex: three coordinates name 2**36 vertices."""


class Draco(Peer):
    """Every frame a mesh of its own, by edgebreaker: connectivity is in each of them and counts here.

    Draco returns vertices in an order of its own. It depends on connectivity alone, so the decoder finds it again
    from a mesh whose vertices stand where their numbers say. Where Draco merges or leaves out vertices, in that mesh
    or in a frame, all frames are coded as points in their original order instead, without faces.
    """

    name = "Draco a frame"
    source = "Google, Draco 1.5; Rossignac 1999, Edgebreaker: connectivity compression for triangle meshes"
    package = "DracoPy"

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        triangles = None if _order_of(connectivity) is None else _triangles(connectivity)
        low = points.reshape(-1, 3).min(axis=0).astype(np.float64)
        extent = float((points.reshape(-1, 3).max(axis=0) - low).max())

        def encode(length: float) -> bytes:
            step = Grid.within(points, length).step
            bits = max(1, math.ceil(math.log2(extent / step + 1.0)))
            if bits > MOST_BITS:
                raise UnreachableError(f"steps of {step:.3g} over {extent:.3g} are more than {MOST_BITS} bits")
            frames = None if triangles is None else _encode_meshes(points, triangles, low, step, bits)
            writer = FieldWriter()
            writer.numbers("QB", points.shape[0], frames is None)
            for frame in frames or [_encode(frame, None, low, step, bits) for frame in points]:
                writer.sized(frame)
            return writer.to_bytes()

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        reader = FieldReader(data, self.name)
        frames, as_points = reader.integers("QB")
        order = None if as_points else _order_of(connectivity)
        points = np.empty((frames, connectivity.vertex_count, 3), np.float32)
        for frame in points:
            frame[slice(None) if order is None else order] = _decode(reader.sized())
        return points


def _encode_meshes(
    points: Float32Array, triangles: NDArray[np.uint32], low: Float64Array, step: float, bits: int
) -> list[bytes] | None:
    """Every frame as a mesh; None where Draco merges or leaves out vertices, or finds no triangle with an area."""
    import DracoPy

    try:
        frames = [_encode(frame, triangles, low, step, bits) for frame in points]
    except DracoPy.EncodingFailedException:
        return None
    return frames if all(len(_decode(frame)) == points.shape[1] for frame in frames) else None


def _encode(
    frame: NDArray[Any], triangles: NDArray[np.uint32] | None, low: Float64Array, step: float, bits: int
) -> bytes:
    """A mesh in Draco's own order of vertices, or without triangles points in theirs."""
    import DracoPy

    data: bytes = DracoPy.encode(
        frame.astype(np.float64),
        triangles,
        quantization_bits=bits,
        quantization_range=step * (2**bits - 1),
        quantization_origin=low,
        compression_level=COMPRESSION_LEVEL,
        preserve_order=triangles is None,
    )
    return data


def _decode(data: bytes) -> Float32Array:
    import DracoPy

    return np.asarray(DracoPy.decode(data).points, np.float32)


def _triangles(connectivity: Connectivity) -> NDArray[np.uint32]:
    return fans(connectivity).astype(np.uint32)


def _order_of(connectivity: Connectivity) -> NDArray[np.int64] | None:
    """Vertex that Draco returns at each place; None where it does not return every vertex once."""
    if connectivity.face_count == 0:
        return None
    mask = 2**NUMBER_BITS - 1
    numbers = np.arange(connectivity.vertex_count)
    named = np.stack([numbers >> shift & mask for shift in (0, NUMBER_BITS, 2 * NUMBER_BITS)], axis=1)
    frames = _encode_meshes(named[None].astype(np.float32), _triangles(connectivity), np.zeros(3), 1.0, NUMBER_BITS)
    if frames is None:
        return None
    found = np.rint(_decode(frames[0])).astype(np.int64)
    order: NDArray[np.int64] = (found << np.array([0, NUMBER_BITS, 2 * NUMBER_BITS])).sum(axis=1)
    return order if np.array_equal(np.sort(order), numbers) else None
