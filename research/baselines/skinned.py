"""Baselines with bones: skinning decomposition with corrections, and a scheme like FAMC of the MPEG-4 standard."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pdecodec.codec.sections.bytestream import FieldReader, FieldWriter
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.sequence import Connectivity
from pdecodec.report.clips.baseline import Baseline, Encoder, Transform, rounded
from pdecodec.research.baselines.coding import (
    decode_over_mesh,
    decode_over_time,
    encode_over_mesh,
    encode_over_time,
)
from pdecodec.research.baselines.skinning import Skinning, fit_skinning, normal_equations
from pdecodec.research.baselines.transforms import Corrected
from pdecodec.research.baselines.traversal import traverse

BONES = (8, 16, 32)
"""Numbers of bones, tried in this order until the bytes grow."""

AFFINE_BONES = 16
"""Clusters of the scheme like FAMC, as many as its reference software was measured with."""

MODEL_SHARE = 0.25
"""Step of translations and of the shape, divided by the given length. It is small because it affects every
vertex and frame.
"""

COARSEST_WEIGHT = 1.0 / 16.0
"""Largest step of weights: the largest of four weights is at least a quarter and must not round to zero."""


@dataclass(frozen=True, eq=False)
class RoundedSkinning:
    """A skinning in quantised values.

    The shape, (vertices, 3) int64 in steps of `step` [scene units]; weights, (vertices, bones) int64 in steps of
    `weight_step`; motions, (frames, bones, 6 or 12) int64: a rotation vector, or the linear part minus the identity,
    then the position of the centre of the bone's vertices in steps of `step`.
    """

    step: float
    weight_step: float
    rest: Int64Array
    weights: Int64Array
    motions: Int64Array

    def centres_and_radii(self) -> tuple[Float64Array, Float64Array]:
        """Centres of the vertices of each bone by their weights, (bones, 3) [scene units], and radii, (bones,)
        in steps.
        """
        share = self.weights / np.maximum(self.weights.sum(axis=0), 1)
        rest = self.rest.astype(np.float64)
        centres = share.T @ rest
        squares = np.einsum("vj,vjk->j", share, (rest[:, None] - centres) ** 2)
        return centres * self.step, np.maximum(np.sqrt(squares), 1.0)

    def skinning(self) -> Skinning:
        """Return the skinning that the quantised values represent."""
        centres, radii = self.centres_and_radii()
        coded = self.motions[..., :-3] / radii[:, None]
        linear = _rotations(coded) if coded.shape[2] == 3 else np.eye(3) + coded.reshape(*coded.shape[:2], 3, 3)
        moved = centres + self.motions[..., -3:] * self.step
        translations = moved - np.einsum("fjkc,jc->fjk", linear, centres)
        return Skinning(
            np.asarray(self.rest * self.step, np.float64),
            self.weights / self.weights.sum(axis=1, keepdims=True),
            np.concatenate([linear, translations[..., None]], axis=3),
        )


def round_skinning(skinning: Skinning, blend: float, length: float, *, rigid: bool) -> RoundedSkinning:
    """Quantise a skinning for a length [scene units]; `blend` is :func:`blend_distance`."""
    step = MODEL_SHARE * length
    weight_step = min(COARSEST_WEIGHT, step / blend if blend > 0.0 else math.inf)
    shape = RoundedSkinning(
        step,
        weight_step,
        rounded(skinning.rest, step),
        rounded(skinning.weights, weight_step),
        np.zeros((len(skinning.transforms), skinning.weights.shape[1], 0), np.int64),
    )
    centres, radii = shape.centres_and_radii()
    linear = skinning.transforms[..., :3]
    moved = np.einsum("fjkc,jc->fjk", linear, centres) + skinning.transforms[..., 3] - centres
    turned = _unwound_vectors(linear) if rigid else (linear - np.eye(3)).reshape(*linear.shape[:2], 9)
    motions = np.concatenate([rounded(turned * radii[:, None], 1.0), rounded(moved, step)], axis=2)
    return RoundedSkinning(step, weight_step, shape.rest, shape.weights, motions)


def blend_distance(points: Float32Array, skinning: Skinning) -> float:
    """Return how far bones disagree: the root mean square distance [scene units] between a vertex and the
    places where each of its bones alone would move it, over the vertices with several bones; 0 if there are
    none.
    """
    gram, _ = normal_equations(points.astype(np.float64), skinning.rest, skinning.transforms)
    weights = skinning.weights
    apart = (np.einsum("vj,vjj->v", weights, gram) - np.einsum("vj,vjk,vk->v", weights, gram, weights)) / len(points)
    blended = np.count_nonzero(weights, axis=1) > 1
    return math.sqrt(max(float(apart[blended].mean()), 0.0)) if blended.any() else 0.0


def write_skinning(writer: FieldWriter, rounded_to: RoundedSkinning, connectivity: Connectivity) -> None:
    frames, bones, numbers = rounded_to.motions.shape
    writer.numbers("2d3Q", rounded_to.step, rounded_to.weight_step, frames, bones, numbers)
    traversal = traverse(connectivity)
    writer.sized(encode_over_mesh(rounded_to.rest, traversal))
    writer.sized(encode_over_mesh(rounded_to.weights, traversal))
    writer.sized(encode_over_time(rounded_to.motions.reshape(frames, -1)))


def read_skinning(reader: FieldReader, connectivity: Connectivity) -> RoundedSkinning:
    step, weight_step = reader.reals("2d")
    frames, bones, numbers = reader.integers("3Q")
    traversal = traverse(connectivity)
    rest = decode_over_mesh(reader.sized(), 3, traversal)
    weights = decode_over_mesh(reader.sized(), bones, traversal)
    motions = decode_over_time(reader.sized(), bones * numbers, frames).reshape(frames, bones, numbers)
    return RoundedSkinning(step, weight_step, rest, weights, motions)


class RigidSkinning(Transform[RoundedSkinning]):
    """A shape and rigid bones without corrections: motion that bones do not explain is lost, so the error has a
    lower limit.

    Parameters
    ----------
    bones : int
    """

    name = "skinning decomposition"
    source = "Le and Deng 2012, Smooth skinning decomposition with rigid bones"

    def __init__(self, bones: int = BONES[0]) -> None:
        self._bones = bones

    def analyse(self, points: Float32Array, connectivity: Connectivity) -> Callable[[float], RoundedSkinning]:
        skinning = fit_skinning(points, self._bones, rigid=True)
        blend = blend_distance(points, skinning)
        return lambda length: round_skinning(skinning, blend, length, rigid=True)

    def write(self, quantised: RoundedSkinning, connectivity: Connectivity) -> bytes:
        writer = FieldWriter()
        write_skinning(writer, quantised, connectivity)
        return writer.to_bytes()

    def read(self, data: bytes, connectivity: Connectivity) -> RoundedSkinning:
        return read_skinning(FieldReader(data, self.name), connectivity)

    def synthesise(self, quantised: RoundedSkinning, connectivity: Connectivity) -> Float32Array:
        points: Float32Array = quantised.skinning().positions().astype(np.float32)
        return points


class SkinningDecomposition(Baseline):
    """Rigid bones, convex weights, and corrections of the vertices beyond the bound, with the best number of bones."""

    name = "skinning decomposition, corrected"
    source = RigidSkinning.source
    published = False

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        encoders: dict[int, Encoder] = {}

        def encode(length: float) -> bytes:
            smallest = b""
            for bones in BONES[: 1 + sum(bones < points.shape[1] for bones in BONES)]:
                if bones not in encoders:
                    encoders[bones] = Corrected(RigidSkinning(bones)).prepare(points, connectivity)
                data = encoders[bones](length)
                if smallest and len(data) >= len(smallest):
                    break
                smallest = data
            return smallest

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        return Corrected(RigidSkinning()).decode(data, connectivity)


@dataclass(frozen=True, eq=False)
class CompensatedMotion:
    """A skinning, and temporal spectra of the residual motion.

    Spectra are (kept, vertices, 3) int64 in steps of `step` [scene units], lowest frequency first; the highest are
    zero and left out.
    """

    step: float
    model: RoundedSkinning
    spectrum: Int64Array


class SkinningCosines(Transform[CompensatedMotion]):
    """Affine motion of clusters, blended by weights, and an adaptively coded DCT over time of the residuals.

    Written from the description of FAMC in its DCT mode, not from its bytes: the rounding of its model, the order of
    spectra and their contexts are our own. Spectra are predicted across the mesh where that makes them smaller.
    """

    name = "affine skinning + DCT"
    source = (
        "Mamou, Zaharia and Prêteux 2006, A skinning approach for dynamic 3D mesh compression; "
        "2008, FAMC: the MPEG-4 standard for animated mesh compression"
    )

    def analyse(self, points: Float32Array, connectivity: Connectivity) -> Callable[[float], CompensatedMotion]:
        from scipy.fft import dct

        skinning = fit_skinning(points, AFFINE_BONES, rigid=False)
        blend = blend_distance(points, skinning)

        def round_to(length: float) -> CompensatedMotion:
            model = round_skinning(skinning, blend, length, rigid=False)
            left = points.astype(np.float64) - model.skinning().positions()
            spectrum = rounded(dct(left, axis=0, norm="ortho", overwrite_x=True), length)
            kept = 1 + max(np.flatnonzero(spectrum.reshape(len(points), -1).any(axis=1)), default=0)
            return CompensatedMotion(length, model, spectrum[:kept])

        return round_to

    def write(self, quantised: CompensatedMotion, connectivity: Connectivity) -> bytes:
        kept = quantised.spectrum
        writer = FieldWriter()
        writer.numbers("dQ", quantised.step, len(kept))
        write_skinning(writer, quantised.model, connectivity)
        columns = kept.transpose(1, 0, 2).reshape(connectivity.vertex_count, 3 * len(kept))
        writer.sized(encode_over_mesh(columns, traverse(connectivity)))
        return writer.to_bytes()

    def read(self, data: bytes, connectivity: Connectivity) -> CompensatedMotion:
        reader = FieldReader(data, self.name)
        (step,) = reader.reals("d")
        (kept,) = reader.integers("Q")
        model = read_skinning(reader, connectivity)
        columns = decode_over_mesh(reader.sized(), 3 * kept, traverse(connectivity))
        return CompensatedMotion(step, model, columns.reshape(-1, kept, 3).transpose(1, 0, 2))

    def synthesise(self, quantised: CompensatedMotion, connectivity: Connectivity) -> Float32Array:
        from scipy.fft import idct

        compensated = quantised.model.skinning().positions()
        spectrum = np.zeros(compensated.shape)
        spectrum[: len(quantised.spectrum)] = quantised.spectrum * quantised.step
        points: Float32Array = (compensated + idct(spectrum, axis=0, norm="ortho")).astype(np.float32)
        return points


def _rotations(vectors: Float64Array) -> Float64Array:
    """Return (..., 3, 3) rotations by (..., 3) rotation vectors."""
    from scipy.spatial.transform import Rotation

    matrices: Float64Array = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix()
    return matrices.reshape(*vectors.shape, 3)


def _unwound_vectors(rotations: Float64Array) -> Float64Array:
    """Return rotation vectors, (frames, bones, 3), of rotations (frames, bones, 3, 3), continuous over frames."""
    from scipy.spatial.transform import Rotation

    vectors: Float64Array = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_rotvec()
    vectors = vectors.reshape(rotations.shape[:3])
    for frame in range(1, len(vectors)):
        angles = np.linalg.norm(vectors[frame], axis=-1, keepdims=True)
        axes = np.divide(vectors[frame], angles, out=np.zeros_like(vectors[frame]), where=angles > 0.0)
        along = (axes * vectors[frame - 1]).sum(axis=-1, keepdims=True)
        vectors[frame] += 2.0 * math.pi * np.rint((along - angles) / (2.0 * math.pi)) * axes
    return vectors
