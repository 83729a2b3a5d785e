"""A cosine transform of every coordinate over the whole clip."""

from __future__ import annotations

import numpy as np

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.peers.peer import Encoder, Peer
from pdecodec.peers.prediction import decode_over_mesh, encode_over_mesh
from pdecodec.peers.traversal import traverse
from pdecodec.sequence import Connectivity, Float32Array


class CosineInTime(Peer):
    """Orthonormal DCT-II in time, one step for all frequencies, each predicted across the mesh."""

    name = "DCT in time"
    source = "Ahmed, Natarajan and Rao 1974, Discrete cosine transform; prediction after Touma and Gotsman 1998"

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        from scipy.fft import dct

        traversal = traverse(connectivity)
        spectrum = dct(points.astype(np.float64), axis=0, norm="ortho")

        def encode(length: float) -> bytes:
            levels = np.rint(spectrum / length).astype(np.int64)
            used = levels.any(axis=(1, 2))
            kept = levels[: used.size - int(used[::-1].argmax())]  # the highest frequencies are nothing
            writer = FieldWriter()
            writer.numbers("d2Q", length, points.shape[0], len(kept))
            writer.sized(encode_over_mesh(kept.transpose(1, 0, 2).reshape(points.shape[1], -1), traversal))
            return writer.to_bytes()

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        from scipy.fft import idct

        reader = FieldReader(data, self.name)
        (length,) = reader.reals("d")
        frames, kept = reader.integers("2Q")
        levels = decode_over_mesh(reader.sized(), 3 * kept, traverse(connectivity))
        spectrum = np.zeros((frames, connectivity.vertex_count, 3))
        spectrum[:kept] = levels.reshape(-1, kept, 3).transpose(1, 0, 2) * length
        points: Float32Array = idct(spectrum, axis=0, norm="ortho").astype(np.float32)
        return points
