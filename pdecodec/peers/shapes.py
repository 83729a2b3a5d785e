"""Principal components of shapes: a frame is a mean shape and a few principal shapes, weighted."""

from __future__ import annotations

import numpy as np

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.peers.peer import Encoder, Peer
from pdecodec.peers.prediction import decode_over_mesh, decode_over_time, encode_over_mesh, encode_over_time
from pdecodec.peers.principal import factor_steps, principal_components, quantise_columns
from pdecodec.peers.traversal import traverse
from pdecodec.sequence import Connectivity, Float32Array


class PrincipalShapes(Peer):
    """Shapes as long as their share of the motion and coded in one step, weights of unit length predicted in time.

    The mean, which every frame takes once, is rounded to the step over the root of the frames. Shapes are predicted
    across the mesh as positions are, which neither paper does and which only makes them smaller.
    """

    name = "principal components of shapes"
    source = (
        "Alexa and Müller 2000, Representing animations by principal components; "
        "Karni and Gotsman 2004, Compression of soft-body animation sequences"
    )

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        traversal = traverse(connectivity)
        frames, vertices = points.shape[:2]
        parts = principal_components(points.reshape(frames, -1).astype(np.float64))
        lengths = np.linalg.norm(parts.coefficients, axis=0)
        shapes, weights = parts.basis * lengths, parts.coefficients / lengths

        def encode(length: float) -> bytes:
            levels, used = quantise_columns(shapes, length)
            mean = np.rint(parts.mean / (length / np.sqrt(frames))).astype(np.int64)
            writer = FieldWriter()
            writer.numbers("d2Q", length, frames, used.size)
            writer.sized(encode_over_mesh(mean.reshape(vertices, 3), traversal))
            writer.sized(encode_over_mesh(levels.reshape(vertices, -1), traversal))
            writer.sized(encode_over_time(np.rint(weights[:, used] / factor_steps(levels)).astype(np.int64)))
            return writer.to_bytes()

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        reader = FieldReader(data, self.name)
        (length,) = reader.reals("d")
        frames, count = reader.integers("2Q")
        traversal = traverse(connectivity)
        mean = decode_over_mesh(reader.sized(), 3, traversal).ravel() * (length / np.sqrt(frames))
        levels = decode_over_mesh(reader.sized(), 3 * count, traversal).reshape(mean.size, count)
        weights = decode_over_time(reader.sized(), count, frames) * factor_steps(levels)
        points: Float32Array = (mean + weights @ (levels * length).T).astype(np.float32).reshape(frames, -1, 3)
        return points
