"""What a pipeline does without a codec: the numbers as they are, in float32 or float16, under zstandard."""

from __future__ import annotations

import numpy as np

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.peers.peer import Encoder, Peer, UnreachableError
from pdecodec.peers.shuffle import squeeze, unsqueeze
from pdecodec.sequence import Connectivity, Float32Array


class _RawPeer(Peer):
    """Positions as `number`, whatever the length."""

    adjustable = False
    number: type[np.float32] | type[np.float16]

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        def encode(length: float) -> bytes:
            largest = float(np.abs(points).max())
            if largest > float(np.finfo(self.number).max):
                raise UnreachableError(f"a coordinate of {largest:.3g} is beyond its numbers")
            writer = FieldWriter()
            writer.numbers("2Q", *points.shape[:2])
            writer.sized(squeeze(points.astype(self.number)))
            return writer.to_bytes()

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        reader = FieldReader(data, self.name)
        frames, vertices = reader.integers("2Q")
        return unsqueeze(reader.sized(), self.number, (frames, vertices, 3)).astype(np.float32)


class RawFloat32(_RawPeer):
    """Float32 positions, bytes of equal weight together, zstandard."""

    name = "float32 + zstd"
    source = "Collet and Kucherawy 2021, RFC 8878"
    number = np.float32


class RawFloat16(_RawPeer):
    """The same in half precision, as game engines keep vertex caches; its error is what it is."""

    name = "float16 + zstd"
    source = "IEEE 754 binary16; RFC 8878"
    number = np.float16
