"""The model a file describes: elements over a rest shape, time segments, and coefficients between them.

One place turns coefficients into positions, for the encoder that checks its bound and for the decoder alike.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pdecodec.alignment import POSE_NUMBERS, pose_matrices, pose_matrix_derivatives
from pdecodec.basis import MAX_RATE, TIME_FUNCTIONS
from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.curves import Curves
from pdecodec.elements import WHOLE_CURVE, Elements, build_elements
from pdecodec.entropy import unpack_integers
from pdecodec.errors import CorruptFileError
from pdecodec.kernels.layout import Layout
from pdecodec.quantise import LARGEST_STEP
from pdecodec.restshape import RestShape
from pdecodec.segments import Term

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

ModelAlignment = Literal["none", "affine", "rotation"]

THREADS_FROM = 2**18
"""Coordinates to evaluate from which threads are worth starting."""

BATCH_BYTES = 32 * 2**20
"""Memory for the combined coefficients of the times evaluated together."""


ALIGNMENT_CODES: tuple[ModelAlignment, ...] = ("none", "affine", "rotation")
"""By their number in the file."""


@dataclass(frozen=True, kw_only=True)
class ModelDescription:
    """Section MODL: what the decoder builds the model from.

    Attributes
    ----------
    alignment : {"none", "affine", "rotation"}
    r : float
        Rate of Eqs. 14 and 16 over half a piece.
    step, correction_step : float [scene units]
        Quantisation steps of the coefficients and of the corrections.
    columns : int
        Functions of all elements together, as a check.
    levels : bytes
        Piece length of each curve (see :func:`pdecodec.elements.piece_starts`), packed.
    """

    alignment: ModelAlignment
    r: float
    step: float
    correction_step: float
    columns: int
    levels: bytes

    def to_bytes(self) -> bytes:
        writer = FieldWriter()
        writer.numbers("B", ALIGNMENT_CODES.index(self.alignment))
        writer.numbers("dddQ", self.r, self.step, self.correction_step, self.columns)
        writer.sized(self.levels)
        return writer.to_bytes()

    @classmethod
    def from_bytes(cls, data: bytes) -> ModelDescription:
        """Undo :meth:`to_bytes`; CorruptFileError where a field is out of range."""
        reader = FieldReader(data, "MODL")
        (alignment,) = reader.integers("B")
        r, step, correction_step = reader.reals("ddd")
        (columns,) = reader.integers("Q")
        levels = reader.sized()
        reader.finish()
        if alignment >= len(ALIGNMENT_CODES):
            raise CorruptFileError(f"section MODL names alignment {alignment}, which is unknown")
        if not (0 <= r <= MAX_RATE and 0 < step <= LARGEST_STEP and 0 < correction_step <= LARGEST_STEP):
            raise CorruptFileError("section MODL has a rate or a quantisation step out of range")
        return cls(
            alignment=ALIGNMENT_CODES[alignment],
            r=r,
            step=step,
            correction_step=correction_step,
            columns=columns,
            levels=levels,
        )

    def piece_levels(self, curves: int) -> NDArray[np.int64]:
        """(curves,) int64: the piece length of each curve; CorruptFileError where one is unknown."""
        levels = unpack_integers(self.levels, curves)
        if levels.min() < 0 or levels.max() > WHOLE_CURVE:
            raise CorruptFileError("section MODL names a piece length that is unknown")
        return levels


@dataclass(frozen=True, eq=False)
class SegmentCoefficients:
    """Coefficients of one segment.

    Attributes
    ----------
    shape : (columns, 3 * functions) float64 [scene units]
        Over the elements' functions; function of time after function of time, x y z within each.
    poses : (elements, 7 * functions) float64, or (0, 7 * functions)
        Alignment as rotation: quaternion (w x y z) and translation, over the functions of time.
    """

    shape: Float64Array
    poses: Float64Array

    @property
    def nbytes(self) -> int:
        return self.shape.nbytes + self.poses.nbytes


@dataclass(frozen=True, eq=False)
class Model:
    """Everything but the coefficients.

    Attributes
    ----------
    elements : Elements
    rest : (vertices, 3) float64 [scene units]
        Decoded rest shape in curve order.
    alignment : {"none", "affine", "rotation"}
    """

    elements: Elements
    rest: Float64Array
    alignment: ModelAlignment

    @cached_property
    def layout(self) -> Layout:
        """Its arrays as compiled loops take them."""
        item = self.elements
        return Layout(item.order, self.rest, item.starts, item.basis, item.basis_starts, item.column_starts)

    @property
    def posed_elements(self) -> int:
        """Elements with a moving frame: all under "rotation", none otherwise."""
        return self.elements.count if self.alignment == "rotation" else 0

    @property
    def coefficients(self) -> int:
        """Coefficients of a segment that uses every function of time."""
        return TIME_FUNCTIONS * (3 * self.elements.columns + POSE_NUMBERS * self.posed_elements)

    def evaluate(
        self, terms: Sequence[Term], coefficients: Callable[[int], SegmentCoefficients], out: Float32Array
    ) -> None:
        """Positions at several times.

        Parameters
        ----------
        terms : sequence of Term
            What each segment contributes at which times.
        coefficients : callable
            Segment index to its coefficients.
        out : (times, vertices, 3) float32 [scene units], written
        """
        numbers = 3 * self.elements.columns + (POSE_NUMBERS + 12) * self.posed_elements
        batch = max(1, BATCH_BYTES // (8 * max(1, numbers)))
        for start in range(0, len(out), batch):
            self._evaluate_batch(terms, out[start : start + batch], start, coefficients)

    def derivative(
        self, order: int, terms: Sequence[Sequence[Term]], coefficients: Callable[[int], SegmentCoefficients]
    ) -> Float64Array:
        """Exact velocities or accelerations at one time.

        Parameters
        ----------
        order : int
            1 or 2.
        terms : sequence of sequences of Term
            What each segment contributes at that time: to positions, to first and to second derivatives.
        coefficients : callable
            Segment index to its coefficients.

        Returns
        -------
        (vertices, 3) float64 [scene units / s^order]
            In the mesh's vertex order.
        """
        elements = self.elements
        shapes, poses = zip(*(self._combined(part, coefficients) for part in terms), strict=True)
        moved = self._displacement(shapes[order])
        if self.posed_elements:
            sizes = np.diff(elements.starts)
            frames = (pose_matrices(poses[0]), *pose_matrix_derivatives(*poses))
            turn = [np.repeat(found[0, :, :9].reshape(-1, 3, 3), sizes, axis=0) for found in frames]
            from_centre = self.rest - np.repeat(self.rest[elements.starts[:-1]], sizes, axis=0)
            offset = from_centre + self._displacement(shapes[0])
            # (M p + T)' = M' p + M p' + T', and once more.
            rotated = np.einsum("nij,nj->ni", turn[0], moved) + np.einsum("nij,nj->ni", turn[order], offset)
            if order == 2:
                rotated += 2.0 * np.einsum("nij,nj->ni", turn[1], self._displacement(shapes[1]))
            moved = rotated + np.repeat(frames[order][0, :, 9:], sizes, axis=0)
        out = np.empty((len(self.rest), 3))
        out[elements.order] = moved
        return out

    def _combined(
        self, terms: Sequence[Term], coefficients: Callable[[int], SegmentCoefficients]
    ) -> tuple[Float64Array, Float64Array]:
        from pdecodec.kernels.motion import combine

        shape = np.zeros((1, self.elements.columns, 3))
        poses = np.zeros((1, self.posed_elements, POSE_NUMBERS))
        for term in terms:
            found = coefficients(term.segment)
            combine(found.shape, term.weights, shape)
            combine(found.poses, term.weights, poses)
        return shape, poses

    def _displacement(self, combined: Float64Array) -> Float64Array:
        """(vertices, 3) float64 in curve order: the functions' sum, without rest shape or moving frames."""
        elements = self.elements
        moved = np.zeros((len(self.rest), 3))
        sizes = np.diff(elements.starts)
        for degree in range(int(elements.ranks.max(initial=0))):
            has = elements.ranks > degree
            inside = np.repeat(has, sizes)
            column = np.repeat(elements.column_starts[:-1] + degree, sizes)[inside]
            place = np.arange(len(moved)) - np.repeat(elements.starts[:-1], sizes)
            value = elements.basis[(np.repeat(elements.basis_starts[:-1] + degree * sizes, sizes) + place)[inside]]
            moved[inside] += value[:, None] * combined[0, column]
        return moved

    def _evaluate_batch(
        self, terms: Sequence[Term], out: Float32Array, start: int, coefficients: Callable[[int], SegmentCoefficients]
    ) -> None:
        from pdecodec.kernels.motion import combine, evaluate, evaluate_elements, evaluate_once

        count, elements = len(out), self.elements
        combined = np.zeros((count, elements.columns, 3))
        poses = np.zeros((count, self.posed_elements, POSE_NUMBERS))
        for term in terms:
            first, last = max(term.rows.start, start), min(term.rows.stop, start + count)
            if first < last:
                weights = term.weights[first - term.rows.start : last - term.rows.start]
                found = coefficients(term.segment)
                combine(found.shape, weights, combined[first - start : last - start])
                combine(found.poses, weights, poses[first - start : last - start])
        arguments = (combined, self.layout, pose_matrices(poses), out)
        if count == 1:
            evaluate_once(*arguments)
        elif out.size < THREADS_FROM:
            evaluate_elements(0, elements.count, *arguments)
        else:
            evaluate(*arguments)


def build_model(
    curves: Curves,
    levels: NDArray[np.integer],
    rest: RestShape,
    *,
    r: float,
    alignment: ModelAlignment,
) -> Model:
    """The model of curves cut to `levels` (see :func:`pdecodec.elements.piece_starts`) over a rest shape."""
    elements = build_elements(curves, levels, rest.levels, r=r, affine=alignment == "affine")
    return Model(elements, rest.points[curves.order], alignment)
