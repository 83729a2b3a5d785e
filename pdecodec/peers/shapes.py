"""Principal components of shapes: a frame is a mean shape and a few principal shapes, weighted."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.peers.prediction import decode_over_mesh, decode_over_time, encode_over_mesh, encode_over_time
from pdecodec.peers.principal import RoundedComponents, factor_steps, principal_components, quantise_columns
from pdecodec.peers.transform import Transform, rounded
from pdecodec.peers.traversal import traverse
from pdecodec.sequence import Connectivity, Float32Array


class PrincipalShapes(Transform[RoundedComponents]):
    """Shapes as long as their share of the motion and coded in one step, weights of unit length predicted in time.

    The mean, which every frame takes once, is rounded to the step over the root of the frames. Shapes are predicted
    across the mesh as positions are, which neither paper does and which only makes them smaller.
    """

    name = "principal components of shapes"
    source = (
        "Alexa and Müller 2000, Representing animations by principal components; "
        "Karni and Gotsman 2004, Compression of soft-body animation sequences"
    )

    def analyse(self, points: Float32Array, connectivity: Connectivity) -> Callable[[float], RoundedComponents]:
        frames = len(points)
        parts = principal_components(points.reshape(frames, -1).astype(np.float64))
        lengths = np.linalg.norm(parts.coefficients, axis=0)
        shapes, weights = parts.basis * lengths, parts.coefficients / lengths

        def round_to(length: float) -> RoundedComponents:
            levels, used = quantise_columns(shapes, length)
            mean = rounded(parts.mean, length / math.sqrt(frames))
            rounded_weights = np.rint(weights[:, used] / factor_steps(levels)).astype(np.int64, order="C")
            return RoundedComponents(length, frames, mean, levels, rounded_weights)

        return round_to

    def write(self, levels: RoundedComponents, connectivity: Connectivity) -> bytes:
        vertices, traversal = connectivity.vertex_count, traverse(connectivity)
        writer = FieldWriter()
        writer.numbers("d2Q", levels.step, levels.frames, levels.coefficients.shape[1])
        writer.sized(encode_over_mesh(levels.mean.reshape(vertices, 3), traversal))
        writer.sized(encode_over_mesh(levels.coefficients.reshape(vertices, -1), traversal))
        writer.sized(encode_over_time(levels.basis))
        return writer.to_bytes()

    def read(self, data: bytes, connectivity: Connectivity) -> RoundedComponents:
        reader = FieldReader(data, self.name)
        (step,) = reader.reals("d")
        frames, count = reader.integers("2Q")
        traversal = traverse(connectivity)
        mean = decode_over_mesh(reader.sized(), 3, traversal).ravel()
        coefficients = decode_over_mesh(reader.sized(), 3 * count, traversal).reshape(mean.size, count)
        return RoundedComponents(step, frames, mean, coefficients, decode_over_time(reader.sized(), count, frames))

    def synthesise(self, levels: RoundedComponents, connectivity: Connectivity) -> Float32Array:
        weights = levels.basis * factor_steps(levels.coefficients)
        mean = levels.mean * (levels.step / math.sqrt(levels.frames))
        shapes = levels.coefficients * levels.step
        points: Float32Array = (mean + weights @ shapes.T).astype(np.float32).reshape(levels.frames, -1, 3)
        return points
