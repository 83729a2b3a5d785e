"""SZ3, an error-bounded compressor of floating-point fields by prediction."""

from __future__ import annotations

import numpy as np

from pdecodec.peers.peer import Encoder, Peer
from pdecodec.peers.planes import decode_planes, encode_planes
from pdecodec.sequence import Connectivity, Float32Array


class Sz3(Peer):
    """Interpolation and Lorenzo prediction under an absolute bound on every coordinate."""

    name = "SZ3"
    source = (
        "Liang et al. 2023, SZ3: a modular framework for composing prediction-based error-bounded lossy compressors"
    )
    package = "pysz"

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        from pysz import sz, szAlgorithm, szConfig, szErrorBoundMode

        def encode(length: float) -> bytes:
            def compress(plane: Float32Array) -> bytes:
                settings = szConfig()
                settings.errorBoundMode = szErrorBoundMode.ABS
                settings.absErrorBound = length
                settings.cmprAlgo = szAlgorithm.INTERP_LORENZO
                compressed, _ = sz.compress(plane, settings)
                return bytes(compressed)

            return encode_planes(points, compress)

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        from pysz import sz

        def decompress(part: bytes, shape: tuple[int, int]) -> Float32Array:
            plane: Float32Array = sz.decompress(np.frombuffer(part, np.uint8), np.float32, shape)[0]
            return plane

        return decode_planes(data, decompress)
