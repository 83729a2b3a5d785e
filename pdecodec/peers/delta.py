"""Quantise, differences in time, zstandard: the forty lines that every studio has written once."""

from __future__ import annotations

import numpy as np

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.peers.grid import Grid
from pdecodec.peers.peer import Encoder, Peer
from pdecodec.peers.shuffle import level_for, narrowest, squeeze, unsqueeze
from pdecodec.sequence import Connectivity, Float32Array


class QuantiseDelta(Peer):
    """Grid levels; the first frame as differences along the vertices, the others as differences in time."""

    name = "quantise + delta in time + zstd"
    source = "common practice; RFC 8878"

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        def encode(length: float) -> bytes:
            grid = Grid.within(points, length)
            levels = grid.levels(points)
            writer = FieldWriter()
            grid.write(writer)
            writer.numbers("2Q", *points.shape[:2])
            for part in (np.diff(levels[:1], axis=1, prepend=0), np.diff(levels, axis=0)):
                narrow = narrowest(part.transpose(0, 2, 1))  # an axis at a time: its numbers are alike
                writer.numbers("Q", narrow.itemsize)
                writer.sized(squeeze(narrow, level=level_for(narrow.nbytes)))
            return writer.to_bytes()

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        reader = FieldReader(data, self.name)
        grid = Grid.read(reader)
        frames, vertices = reader.integers("2Q")
        parts = []
        for count in (1, frames - 1):
            number = np.dtype(f"i{reader.integers('Q')[0]}")
            parts.append(unsqueeze(reader.sized(), number, (count, 3, vertices)).astype(np.int64))
        levels = np.concatenate([np.cumsum(parts[0], axis=2), parts[1]])
        return grid.positions(np.cumsum(levels, axis=0).transpose(0, 2, 1))
