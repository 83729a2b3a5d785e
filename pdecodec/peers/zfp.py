"""zfp, a compressor of floating-point fields in blocks."""

from __future__ import annotations

import math

from pdecodec.peers.peer import Encoder, Peer
from pdecodec.peers.planes import decode_planes, encode_planes
from pdecodec.sequence import Connectivity, Float32Array


class Zfp(Peer):
    """Fixed accuracy; only powers of two make a difference to it, so it seldom meets a bound closely."""

    name = "zfp"
    source = "Lindstrom 2014, Fixed-rate compressed floating-point arrays; fixed-accuracy mode"
    package = "zfpy"

    def effective_length(self, length: float) -> float:
        return math.ldexp(1.0, math.frexp(length)[1] - 1)

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        import zfpy

        return lambda length: encode_planes(points, lambda plane: zfpy.compress_numpy(plane, tolerance=length))

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        import zfpy

        return decode_planes(data, lambda part, shape: zfpy.decompress_numpy(part))
