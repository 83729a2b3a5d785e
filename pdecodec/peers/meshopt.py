"""meshoptimizer's vertex codec, as glTF's EXT_meshopt_compression carries it."""

from __future__ import annotations

import numpy as np
import zstandard

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.peers.grid import Grid
from pdecodec.peers.peer import Encoder, Peer, UnreachableError
from pdecodec.peers.shuffle import level_for
from pdecodec.sequence import Connectivity, Float32Array

VERTEX_BYTES = 8
"""Three 16-bit levels and padding: the codec takes multiples of four bytes."""

CODEC_LEVEL = 3


class Meshopt(Peer):
    """16-bit levels, differences from frame to frame, the vertex codec, and zstandard over all of it."""

    name = "meshopt vertex codec + zstd"
    source = "Kapoulkine 2017 to 2025, meshoptimizer"
    package = "imagecodecs"

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        from imagecodecs import meshopt_encode

        def encode(length: float) -> bytes:
            grid = Grid.within(points, length)
            differences = np.diff(grid.levels(points), axis=0, prepend=0)
            if np.abs(differences).max() > np.iinfo(np.int16).max:
                raise UnreachableError(f"steps of {grid.step:.3g} need more than 16 bits")
            padded = np.zeros((*points.shape[:2], VERTEX_BYTES // 2), np.int16)
            padded[..., :3] = differences
            writer = FieldWriter()
            grid.write(writer)
            writer.numbers("Q", points.shape[0])
            for frame in padded:
                writer.sized(bytes(meshopt_encode(frame.view(np.uint8), level=CODEC_LEVEL)))
            frames = writer.to_bytes()
            return zstandard.ZstdCompressor(level=level_for(len(frames))).compress(frames)

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        from imagecodecs import meshopt_decode

        reader = FieldReader(zstandard.ZstdDecompressor().decompress(data), self.name)
        grid = Grid.read(reader)
        shape = (connectivity.vertex_count, VERTEX_BYTES)
        frames = [
            meshopt_decode(reader.sized(), shape=shape, dtype=np.uint8).reshape(shape).view(np.int16)[:, :3]
            for _ in range(reader.integers("Q")[0])
        ]
        return grid.positions(np.cumsum(np.stack(frames).astype(np.int64), axis=0))
