"""Coddyac: principal components of whole trajectories, their coefficients predicted across the mesh."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.peers.prediction import decode_over_mesh, decode_over_time, encode_over_mesh, encode_over_time
from pdecodec.peers.principal import RoundedComponents, factor_steps, principal_components, quantise_columns
from pdecodec.peers.transform import Transform, rounded
from pdecodec.peers.traversal import traverse
from pdecodec.sequence import Connectivity, Float32Array

MEAN_STEP = 0.125
"""Step of the mean trajectory over that of the coefficients: few numbers, and every vertex takes their error."""


class Coddyac(Transform[RoundedComponents]):
    """One trajectory of x, y and z over all frames is a vector; the basis is coded as differences in time (COBRA)."""

    name = "Coddyac"
    source = (
        "Váša and Skala 2007, CODDYAC: connectivity driven dynamic mesh compression; "
        "2009, COBRA: compression of the basis for PCA represented animations"
    )

    def analyse(self, points: Float32Array, connectivity: Connectivity) -> Callable[[float], RoundedComponents]:
        frames, vertices = points.shape[:2]
        parts = principal_components(points.transpose(1, 0, 2).reshape(vertices, -1).astype(np.float64))

        def round_to(length: float) -> RoundedComponents:
            levels, used = quantise_columns(parts.coefficients, length)
            basis = np.rint(parts.basis[:, used] / factor_steps(levels)).astype(np.int64, order="C")
            mean = rounded(parts.mean, MEAN_STEP * length)
            return RoundedComponents(length, frames, mean, levels, basis)

        return round_to

    def write(self, levels: RoundedComponents, connectivity: Connectivity) -> bytes:
        frames = levels.frames
        writer = FieldWriter()
        writer.numbers("d2Q", levels.step, frames, levels.coefficients.shape[1])
        writer.sized(encode_over_time(levels.mean.reshape(frames, 3)))
        writer.sized(encode_over_mesh(levels.coefficients, traverse(connectivity)))
        writer.sized(encode_over_time(levels.basis.reshape(frames, -1)))
        return writer.to_bytes()

    def read(self, data: bytes, connectivity: Connectivity) -> RoundedComponents:
        reader = FieldReader(data, self.name)
        (step,) = reader.reals("d")
        frames, count = reader.integers("2Q")
        mean = decode_over_time(reader.sized(), 3, frames).ravel()
        coefficients = decode_over_mesh(reader.sized(), count, traverse(connectivity))
        basis = decode_over_time(reader.sized(), 3 * count, frames).reshape(3 * frames, count)
        return RoundedComponents(step, frames, mean, coefficients, basis)

    def synthesise(self, levels: RoundedComponents, connectivity: Connectivity) -> Float32Array:
        basis = levels.basis * factor_steps(levels.coefficients)
        trajectories = levels.mean * (MEAN_STEP * levels.step) + (levels.coefficients * levels.step) @ basis.T
        points = trajectories.astype(np.float32).reshape(-1, levels.frames, 3).transpose(1, 0, 2)
        return np.ascontiguousarray(points)
