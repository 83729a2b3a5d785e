"""Baselines with a transform: cosines, principal shapes or principal trajectories, each alone or with corrections."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pdecodec.codec.sections.bytestream import FieldReader, FieldWriter
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.sequence import Connectivity
from pdecodec.report.clips.baseline import Baseline, Encoder, Transform, rounded
from pdecodec.research.baselines.coding import (
    decode_bands,
    decode_over_mesh,
    decode_over_time,
    encode_bands,
    encode_over_mesh,
    encode_over_time,
)
from pdecodec.research.baselines.neighbours import decode_fitted, encode_fitted
from pdecodec.research.baselines.quantised import grid_step
from pdecodec.research.baselines.traversal import Traversal, traverse

MIN_VARIANCE_RATIO = 1e-14
"""A component whose variance, divided by the largest, is below this is only rounding error of the Gram matrix."""

FACTOR_SHARE = 0.25
"""Quantisation step of the second factor, times the largest coefficient, divided by the step of the coefficients."""

COARSEST_FACTOR = 0.05
"""Largest quantisation step of the second factor, whose columns have length 1."""

MEAN_STEP = 0.125
"""Quantisation step of the mean trajectory, divided by that of the coefficients. A fine step costs little,
since the mean is few numbers, and its error affects every vertex.
"""

LENGTH_RATIOS = (1.5, 2.0, 3.0, 4.5)
"""Error lengths given to the transform, divided by the bound; tried in this order until the bytes grow."""


@dataclass(frozen=True, eq=False)
class Frequencies:
    """Rounded spectrum of a clip.

    (kept, vertices, 3) int64 in steps [scene units], lowest frequency first; the highest are zero and left out.
    """

    step: float
    frames: int
    coefficients: Int64Array


class CosineInTime(Transform[Frequencies]):
    """Orthonormal DCT-II in time, one step for all frequencies, each predicted across the mesh."""

    name = "DCT in time"
    source = "Ahmed, Natarajan and Rao 1974, Discrete cosine transform; prediction after Touma and Gotsman 1998"

    def analyse(self, points: Float32Array, connectivity: Connectivity) -> Callable[[float], Frequencies]:
        from scipy.fft import dct

        spectrum = dct(points.astype(np.float64), axis=0, norm="ortho")

        def round_to(length: float) -> Frequencies:
            quantised = rounded(spectrum, length)
            kept = 1 + max(np.flatnonzero(quantised.reshape(len(points), -1).any(axis=1)), default=0)
            return Frequencies(length, len(points), quantised[:kept])

        return round_to

    def write(self, quantised: Frequencies, connectivity: Connectivity) -> bytes:
        kept = quantised.coefficients
        writer = FieldWriter()
        writer.numbers("d2Q", quantised.step, quantised.frames, len(kept))
        columns = kept.transpose(1, 0, 2).reshape(connectivity.vertex_count, -1)
        writer.sized(encode_over_mesh(columns, traverse(connectivity)))
        return writer.to_bytes()

    def read(self, data: bytes, connectivity: Connectivity) -> Frequencies:
        reader = FieldReader(data, self.name)
        (step,) = reader.reals("d")
        frames, kept = reader.integers("2Q")
        columns = decode_over_mesh(reader.sized(), 3 * kept, traverse(connectivity))
        return Frequencies(step, frames, columns.reshape(-1, kept, 3).transpose(1, 0, 2))

    def synthesise(self, quantised: Frequencies, connectivity: Connectivity) -> Float32Array:
        from scipy.fft import idct

        spectrum = np.zeros((quantised.frames, connectivity.vertex_count, 3))
        spectrum[: len(quantised.coefficients)] = quantised.coefficients * quantised.step
        points: Float32Array = idct(spectrum, axis=0, norm="ortho", overwrite_x=True).astype(np.float32)
        return points


@dataclass(frozen=True, eq=False)
class RoundedComponents:
    """Both factors and the mean of a clip as quantised values, int64.

    ``(rows, components)`` coefficients have the step `step` [scene units]; the basis, (columns, components), has the
    steps of :func:`factor_steps`.
    """

    step: float
    frames: int
    mean: Int64Array
    coefficients: Int64Array
    basis: Int64Array


def principal_components(rows: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return principal components of (rows, columns) float64, by the eigenvectors of the smaller Gram matrix.

    The mean of the rows, (columns,); an orthonormal basis, (columns, components); and coefficients, (rows,
    components), in orthogonal columns, the longest first: ``rows = mean + coefficients @ basis.T`` except for
    rounding.
    """
    mean = rows.mean(axis=0)
    centred = rows - mean
    wide = centred.shape[1] > centred.shape[0]
    gram = centred @ centred.T if wide else centred.T @ centred
    variances, vectors = np.linalg.eigh(gram)
    largest = np.argsort(-variances, kind="stable")
    largest = largest[variances[largest] > MIN_VARIANCE_RATIO * max(float(variances.max()), np.finfo(float).tiny)]
    vectors = vectors[:, largest]
    if not wide:
        return mean, vectors, centred @ vectors
    lengths = np.sqrt(variances[largest])
    return mean, centred.T @ vectors / lengths, vectors * lengths


def quantise_columns(columns: Float64Array, step: float) -> tuple[Int64Array, Int64Array]:
    """Quantise columns; return those that are not zero, (rows, used), and their indices, (used,)."""
    quantised = rounded(columns, step)
    used = np.flatnonzero(quantised.any(axis=0))
    return np.ascontiguousarray(quantised[:, used]), used


def factor_steps(quantised: Int64Array) -> Float64Array:
    """Return the steps, (components,), of the factor that multiplies `quantised`. The decoder computes the same
    steps.
    """
    steps: Float64Array = np.minimum(COARSEST_FACTOR, FACTOR_SHARE / np.abs(quantised).max(axis=0, initial=1))
    return steps


class PrincipalShapes(Transform[RoundedComponents]):
    """Principal shapes, scaled by their share of the motion and coded with one step; weights of unit length, predicted
    in time.

    The mean, which every frame uses once, is rounded to the step divided by the root of the number of frames. Shapes
    are predicted across the mesh like positions; neither paper does that, and it only saves bytes.
    """

    name = "principal components of shapes"
    source = (
        "Alexa and Müller 2000, Representing animations by principal components; "
        "Karni and Gotsman 2004, Compression of soft-body animation sequences"
    )

    def analyse(self, points: Float32Array, connectivity: Connectivity) -> Callable[[float], RoundedComponents]:
        frames = len(points)
        average, basis, coefficients = principal_components(points.reshape(frames, -1).astype(np.float64))
        lengths = np.linalg.norm(coefficients, axis=0)
        shapes, weights = basis * lengths, coefficients / lengths

        def round_to(length: float) -> RoundedComponents:
            quantised, used = quantise_columns(shapes, length)
            mean = rounded(average, length / math.sqrt(frames))
            rounded_weights = np.rint(weights[:, used] / factor_steps(quantised)).astype(np.int64, order="C")
            return RoundedComponents(length, frames, mean, quantised, rounded_weights)

        return round_to

    def write(self, quantised: RoundedComponents, connectivity: Connectivity) -> bytes:
        vertices, traversal = connectivity.vertex_count, traverse(connectivity)
        writer = FieldWriter()
        writer.numbers("d2Q", quantised.step, quantised.frames, quantised.coefficients.shape[1])
        writer.sized(encode_over_mesh(quantised.mean.reshape(vertices, 3), traversal))
        writer.sized(encode_over_mesh(quantised.coefficients.reshape(vertices, -1), traversal))
        writer.sized(encode_over_time(quantised.basis))
        return writer.to_bytes()

    def read(self, data: bytes, connectivity: Connectivity) -> RoundedComponents:
        reader = FieldReader(data, self.name)
        (step,) = reader.reals("d")
        frames, count = reader.integers("2Q")
        traversal = traverse(connectivity)
        mean = decode_over_mesh(reader.sized(), 3, traversal).ravel()
        coefficients = decode_over_mesh(reader.sized(), 3 * count, traversal).reshape(mean.size, count)
        return RoundedComponents(step, frames, mean, coefficients, decode_over_time(reader.sized(), count, frames))

    def synthesise(self, quantised: RoundedComponents, connectivity: Connectivity) -> Float32Array:
        weights = quantised.basis * factor_steps(quantised.coefficients)
        mean = quantised.mean * (quantised.step / math.sqrt(quantised.frames))
        shapes = quantised.coefficients * quantised.step
        points: Float32Array = (mean + weights @ shapes.T).astype(np.float32).reshape(quantised.frames, -1, 3)
        return points


class Coddyac(Transform[RoundedComponents]):
    """Principal trajectories: x, y and z of a vertex over all frames are one vector. The basis is coded as
    differences in time (COBRA).
    """

    name = "Coddyac"
    source = (
        "Váša and Skala 2007, CODDYAC: connectivity driven dynamic mesh compression; "
        "2009, COBRA: compression of the basis for PCA represented animations"
    )

    def analyse(self, points: Float32Array, connectivity: Connectivity) -> Callable[[float], RoundedComponents]:
        frames, vertices = points.shape[:2]
        trajectories = points.transpose(1, 0, 2).reshape(vertices, -1).astype(np.float64)
        average, components, coefficients = principal_components(trajectories)

        def round_to(length: float) -> RoundedComponents:
            quantised, used = quantise_columns(coefficients, length)
            basis = np.rint(components[:, used] / factor_steps(quantised)).astype(np.int64, order="C")
            return RoundedComponents(length, frames, rounded(average, MEAN_STEP * length), quantised, basis)

        return round_to

    def write(self, quantised: RoundedComponents, connectivity: Connectivity) -> bytes:
        frames = quantised.frames
        writer = FieldWriter()
        writer.numbers("d2Q", quantised.step, frames, quantised.coefficients.shape[1])
        writer.sized(encode_over_time(quantised.mean.reshape(frames, 3)))
        writer.sized(self._write_coefficients(quantised.coefficients, traverse(connectivity)))
        writer.sized(encode_over_time(quantised.basis.reshape(frames, -1)))
        return writer.to_bytes()

    def read(self, data: bytes, connectivity: Connectivity) -> RoundedComponents:
        reader = FieldReader(data, self.name)
        (step,) = reader.reals("d")
        frames, count = reader.integers("2Q")
        mean = decode_over_time(reader.sized(), 3, frames).ravel()
        coefficients = self._read_coefficients(reader.sized(), count, traverse(connectivity))
        basis = decode_over_time(reader.sized(), 3 * count, frames).reshape(3 * frames, count)
        return RoundedComponents(step, frames, mean, coefficients, basis)

    def synthesise(self, quantised: RoundedComponents, connectivity: Connectivity) -> Float32Array:
        basis = quantised.basis * factor_steps(quantised.coefficients)
        mean, coefficients = quantised.mean * (MEAN_STEP * quantised.step), quantised.coefficients * quantised.step
        trajectories = mean + coefficients @ basis.T
        points = trajectories.astype(np.float32).reshape(-1, quantised.frames, 3).transpose(1, 0, 2)
        return np.ascontiguousarray(points)

    def _write_coefficients(self, coefficients: Int64Array, traversal: Traversal) -> bytes:
        return encode_over_mesh(coefficients, traversal)

    def _read_coefficients(self, data: bytes, count: int, traversal: Traversal) -> Int64Array:
        return decode_over_mesh(data, count, traversal)


class FittedCoddyac(Coddyac):
    """Like :class:`Coddyac`, but coefficients are predicted by weights fitted to the coefficients of larger components.

    Its source fits weights to the mean shape and to the decoded neighbourhood; fitting them to coefficients is our
    own idea.
    """

    published = False
    name = "Coddyac, fitted"
    source = (
        f"{Coddyac.source}; prediction after 2010, "
        "Geometry-driven local neighbourhood based predictors for dynamic mesh compression"
    )

    def _write_coefficients(self, coefficients: Int64Array, traversal: Traversal) -> bytes:
        return encode_fitted(coefficients, traversal)

    def _read_coefficients(self, data: bytes, count: int, traversal: Traversal) -> Int64Array:
        return decode_fitted(data, count, traversal)


class Corrected(Baseline):
    """Keep a bound with any transform: a coarser transform, and quantised residuals of the vertices beyond the bound.

    None of the papers above has corrections. The codec compared with them keeps its bound by residuals, so they get
    residuals too.

    Parameters
    ----------
    transform : Transform
    """

    published = False

    def __init__(self, transform: Transform[Any]) -> None:
        self._transform = transform
        self.name = f"{transform.name}, corrected"
        self.source = transform.source

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        transform = self._transform
        round_to = transform.analyse(points, connectivity)

        def encode(length: float) -> bytes:
            smallest, of_transform, before = b"", b"", 0.0
            for coarser in LENGTH_RATIOS:
                quantised = round_to(coarser * length)
                missing = points.astype(np.float64) - transform.synthesise(quantised, connectivity)
                beyond = np.einsum("fvk,fvk->fv", missing, missing) > length**2
                residuals = np.zeros(points.shape, np.int64)
                residuals[beyond] = rounded(missing[beyond], grid_step(length))
                coded = encode_bands(residuals.reshape(len(points), -1))
                # A transform's bytes fall by a smaller factor than its length grows, which often shows without coding
                # that a coarser transform cannot gain.
                if smallest and len(coded) + len(of_transform) * before / coarser >= len(smallest):
                    break
                of_transform, before = transform.write(quantised, connectivity), coarser
                writer = FieldWriter()
                writer.numbers("d", grid_step(length))
                writer.sized(of_transform)
                writer.sized(coded)
                data = writer.to_bytes()
                if smallest and len(data) >= len(smallest):
                    break
                smallest = data
            return smallest

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        reader = FieldReader(data, self.name)
        (step,) = reader.reals("d")
        points = self._transform.decode(reader.sized(), connectivity)
        residuals = decode_bands(reader.sized(), len(points), points[0].size).reshape(points.shape)
        corrected: Float32Array = (points + residuals * step).astype(np.float32)
        return corrected
