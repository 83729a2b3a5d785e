"""Coddyac: principal components of whole trajectories, their coefficients predicted across the mesh."""

from __future__ import annotations

import numpy as np

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.peers.peer import Encoder, Peer
from pdecodec.peers.prediction import decode_over_mesh, decode_over_time, encode_over_mesh, encode_over_time
from pdecodec.peers.principal import factor_steps, principal_components, quantise_columns
from pdecodec.peers.traversal import traverse
from pdecodec.sequence import Connectivity, Float32Array

MEAN_STEP = 0.125
"""Step of the mean trajectory over that of the coefficients: few numbers, and every vertex takes their error."""


class Coddyac(Peer):
    """One trajectory of x, y and z over all frames is a vector; the basis is coded as differences in time (COBRA)."""

    name = "Coddyac"
    source = (
        "Váša and Skala 2007, CODDYAC: connectivity driven dynamic mesh compression; "
        "2009, COBRA: compression of the basis for PCA represented animations"
    )

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        traversal = traverse(connectivity)
        frames, vertices = points.shape[:2]
        parts = principal_components(points.transpose(1, 0, 2).reshape(vertices, -1).astype(np.float64))

        def encode(length: float) -> bytes:
            levels, used = quantise_columns(parts.coefficients, length)
            basis = np.rint(parts.basis[:, used] / factor_steps(levels)).astype(np.int64)
            mean = np.rint(parts.mean / (MEAN_STEP * length)).astype(np.int64)
            writer = FieldWriter()
            writer.numbers("d2Q", length, frames, used.size)
            writer.sized(encode_over_time(mean.reshape(frames, 3)))
            writer.sized(encode_over_mesh(levels, traversal))
            writer.sized(encode_over_time(basis.reshape(frames, -1)))
            return writer.to_bytes()

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        reader = FieldReader(data, self.name)
        (length,) = reader.reals("d")
        frames, count = reader.integers("2Q")
        mean = decode_over_time(reader.sized(), 3, frames).ravel() * (MEAN_STEP * length)
        levels = decode_over_mesh(reader.sized(), count, traverse(connectivity))
        basis = decode_over_time(reader.sized(), 3 * count, frames).reshape(3 * frames, count)
        trajectories = mean + (levels * length) @ (basis * factor_steps(levels)).T
        points = trajectories.astype(np.float32).reshape(-1, frames, 3).transpose(1, 0, 2)
        return np.ascontiguousarray(points)
