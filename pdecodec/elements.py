"""Elements: curve pieces with an orthonormal set of space functions each.

An element is a run of consecutive points of one curve. Its functions are, in this order, the affine four
``1, x, y, z`` of the rest shape (where alignment is affine: what the literal Eq. 23 amounts to once its
matrices are data), then the eight functions of Eqs. 14 and 16 of ``u``, the arc length of the rest shape
over [-1, 1]. They are orthonormalised in that order; dependent ones are dropped. All of it is a function of
the decoded rest shape in whole quantisation steps, so that the decoder rebuilds the same bits.

Departs from the paper: Eq. 24 takes ``u`` from the coordinate that is to be decoded, which no decoder knows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pdecodec.basis import SPACE_FUNCTIONS, series_functions
from pdecodec.curves import Curves

Float64Array = NDArray[np.float64]
Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]

PIECE_POINTS = (4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)
"""Piece lengths to choose from, by level; a level one past the end leaves the curve whole."""

WHOLE_CURVE = len(PIECE_POINTS)
"""The level of a curve that is not cut."""


@dataclass(frozen=True, eq=False)
class Elements:
    """Curve pieces and their orthonormal functions; vertices stand in curve order.

    Attributes
    ----------
    order : (vertices,) int32
        Vertex of the mesh at each place of the curve order.
    starts : (elements + 1,) int64
        Element e holds places ``starts[e]`` to ``starts[e + 1] - 1``.
    curve_of : (elements,) int64
        Curve that each element is a piece of.
    basis : (sum of rank * size,) float64
        Functions of element e from ``basis_starts[e]``, one after the other, orthonormal over its points.
    basis_starts, column_starts : (elements + 1,) int64
        Where an element begins in `basis`, and among the columns (functions of all elements).
    kept : (columns,) int64
        Which function each column was before orthonormalisation; the affine four first, if there.
    """

    order: Int32Array
    starts: Int64Array
    curve_of: Int64Array
    basis: Float64Array
    basis_starts: Int64Array
    column_starts: Int64Array
    kept: Int64Array

    @property
    def count(self) -> int:
        return int(self.starts.size - 1)

    @property
    def columns(self) -> int:
        return int(self.column_starts[-1])

    @property
    def ranks(self) -> Int64Array:
        return np.diff(self.column_starts)

    @cached_property
    def by_degree(self) -> Int64Array:
        """(columns,) int64: the columns in order of their place within their element, the smoothest first."""
        degree = np.arange(self.columns) - np.repeat(self.column_starts[:-1], self.ranks)
        return np.argsort(degree, kind="stable")


def piece_starts(curves: Curves, levels: NDArray[np.integer]) -> tuple[Int64Array, Int64Array]:
    """Cut each curve into pieces of nearly equal size, about ``PIECE_POINTS[level]`` points each.

    Parameters
    ----------
    curves : Curves
    levels : (curves,) integer
        0 to :data:`WHOLE_CURVE`.

    Returns
    -------
    starts : (elements + 1,) int64
    curve_of : (elements,) int64
    """
    lengths = curves.lengths
    wanted = np.append(PIECE_POINTS, np.iinfo(np.int64).max)[levels]
    # Half up, in whole numbers; the widest level would overflow a sum, so it is compared first.
    pieces = np.where(
        lengths <= wanted, 1, (2 * lengths + np.minimum(wanted, lengths)) // (2 * np.minimum(wanted, lengths))
    )
    curve_of = np.repeat(np.arange(curves.count), pieces)
    piece = np.arange(curve_of.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    starts = curves.starts[curve_of] + piece * lengths[curve_of] // pieces[curve_of]
    return np.append(starts, curves.starts[-1]), curve_of


def build_elements(
    curves: Curves, levels: NDArray[np.integer], rest: NDArray[np.int64], *, r: float, affine: bool
) -> Elements:
    """Elements and their functions from what the decoder knows.

    Parameters
    ----------
    curves : Curves
    levels : (curves,) integer
        Piece length of each curve, see :func:`piece_starts`.
    rest : (vertices, 3) int64
        Decoded rest shape in quantisation steps, in the mesh's vertex order.
    r : float
        Rate of Eqs. 14 and 16 over half a piece.
    affine : bool
        Whether the affine four come first.
    """
    from pdecodec.kernels.orthonormal import DEPENDENT, orthonormalise_elements

    starts, curve_of = piece_starts(curves, levels)
    along = rest[curves.order].astype(np.float64)
    first = along[starts[:-1]]
    sizes = np.diff(starts)
    local = along - np.repeat(first, sizes, axis=0)
    parameter = arc_length_parameter(local, starts)
    shape = series_functions(parameter, r, SPACE_FUNCTIONS)
    columns = np.column_stack([np.ones(len(local)), local, shape]) if affine else shape
    most = np.minimum(sizes, columns.shape[1])
    room = np.concatenate([[0], np.cumsum(most * sizes)])
    basis = np.empty(int(room[-1]))
    kept = np.empty((sizes.size, columns.shape[1]), np.int64)
    ranks = np.empty(sizes.size, np.int64)
    orthonormalise_elements(columns, starts, room, DEPENDENT, basis, kept, ranks)
    packed = np.concatenate([[0], np.cumsum(ranks * sizes)])
    if packed[-1] != room[-1]:  # some functions were dropped: close the gaps
        used = np.arange(basis.size) - np.repeat(room[:-1], np.diff(room)) < np.repeat(ranks * sizes, np.diff(room))
        basis = basis[used]
    return Elements(
        order=curves.order,
        starts=starts,
        curve_of=curve_of,
        basis=basis,
        basis_starts=packed.astype(np.int64),
        column_starts=np.concatenate([[0], np.cumsum(ranks)]).astype(np.int64),
        kept=kept[np.arange(columns.shape[1]) < ranks[:, None]],
    )


def arc_length_parameter(local: Float64Array, starts: Int64Array) -> Float64Array:
    """Parameter u in [-1, 1] along each element by arc length of the rest shape.

    By index where all points of an element coincide; 0 for an element of one point.

    Parameters
    ----------
    local : (vertices, 3) float64
        Rest shape along the curves.
    starts : (elements + 1,) int64

    Returns
    -------
    (vertices,) float64
    """
    from pdecodec.kernels.orthonormal import running_lengths

    parameter = np.empty(len(local))
    running_lengths(local, starts, parameter)
    return parameter
