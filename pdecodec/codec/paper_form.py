"""Coefficients as the paper writes them: c_w1 .. c_w32 of Eq. 17 for every curve and axis, and the functions
that they multiply.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pdecodec.codec.sections.closed_form import (
    SPACE_FUNCTIONS,
    TIME_FUNCTIONS,
    ClosedForm,
    series_functions,
    series_to_paper,
)
from pdecodec.codec.sections.reference import ReferenceFrame
from pdecodec.codec.sections.space_basis import SpaceBasis, arc_length_parameter
from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float64Array, Int64Array

MIN_RATE = 1e-30
"""Smallest alpha and r: the conversion divides by powers up to alpha^3 and r^7, which float64 must hold."""


@dataclass(frozen=True, eq=False)
class PaperForm:
    """One group of frames in the terms of Eq. 18.

    The position of the vertex ``order[i]``, in piece p, on axis x, at a time t of the group is
    ``reference[i, x] + sum over a, b of T_a(s) coefficients[p, x, a, b] U_b(u[i])`` with ``s = (t - centre) /
    half_length``, T of Eq. 12 and U of Eqs. 14 and 16 (`paper_time_functions` and `paper_space_functions` of
    :mod:`pdecodec.codec.sections.closed_form`). Residuals of a file with a bound are not part of it.

    Attributes
    ----------
    coefficients : (pieces, 3, 4, 8) float64 [scene units]
        Piece, axis, function of time, function of space: c_w1 .. c_w32 in the paper's order are the last two axes, row
        after row.
    condition : (pieces,) float64
        Condition number of each conversion: the digits that its coefficients have lost are its logarithm.
    order : (vertices,) int64
        Vertices of the mesh along the curves, piece after piece.
    starts : (pieces + 1,) int64
        Piece p holds ``order[starts[p]:starts[p + 1]]``.
    reference : (vertices, 3) float64 [scene units]
        Reference frame in that order.
    u : (vertices,) float64
        The argument of Eqs. 14 and 16 in that order, in [-1, 1] along each piece.
    alpha, r : float
    times : (frames,) float64 [s]
        Of the group's frames.
    centre, half_length : float [s]
        The argument of Eq. 12 at a time t is (t - centre) / half_length.
    first_frame : int
    """

    coefficients: Float64Array
    condition: Float64Array
    order: Int64Array
    starts: Int64Array
    reference: Float64Array
    u: Float64Array
    alpha: float
    r: float
    times: Float64Array
    centre: float
    half_length: float
    first_frame: int


def paper_form(
    reference: ReferenceFrame,
    space: SpaceBasis,
    values: Float64Array,
    times: Float64Array,
    *,
    alpha: float,
    functions: int,
    first_frame: int,
) -> PaperForm:
    """Convert the coefficients of one group.

    A piece of fewer than 8 points, or a group of fewer than 4 frames, has as many functions as points or frames.
    They are the first functions of the well-conditioned basis, each a combination of all of the paper's functions.

    Parameters
    ----------
    reference : ReferenceFrame
    space : SpaceBasis
    values : (functions of space, functions of time x axes) float64 [scene units]
        Coefficients of the file.
    times : (frames,) float64 [s]
        Times of the group's frames.
    alpha : float
        Rate of Eq. 12 over half the group.
    functions, first_frame : int
        Number of functions of time, and the group's first frame.

    Raises
    ------
    SettingsError
        If the file's functions are not those of Eq. 18.
    """
    form = space.form
    if form.kind != "curve" or form.affine or form.functions != SPACE_FUNCTIONS:
        raise SettingsError("this file's functions are not the 32 of the paper; encode with profile paper")
    time_form = ClosedForm(times, alpha, functions)
    if min(time_form.alpha, form.rate) < MIN_RATE:
        raise SettingsError("an alpha or r this small makes the paper's functions dependent; encode with a larger one")
    found = values.reshape(space.functions, functions, 3)
    # psi = phi R^-1 in time. Functions that a short group lacks contribute nothing.
    time = np.zeros((TIME_FUNCTIONS, time_form.functions))
    time[: time_form.functions] = np.linalg.inv(time_form.triangle) if time_form.functions else 0.0
    to_paper_time = series_to_paper(time_form.alpha, TIME_FUNCTIONS) @ time
    to_paper_space = series_to_paper(form.rate, SPACE_FUNCTIONS)
    order, starts = space.order.astype(np.int64), space.starts
    u = arc_length_parameter(reference.grid, space.patches)
    series = series_functions(u, form.rate, SPACE_FUNCTIONS)
    coefficient_starts = space.coefficient_starts
    pieces = space.element_count
    coefficients = np.zeros((pieces, 3, TIME_FUNCTIONS, SPACE_FUNCTIONS))
    condition = np.ones(pieces)
    time_condition = np.linalg.cond(to_paper_time) if time_form.functions else 1.0
    for p, own_functions in enumerate(space.functions_of_elements()):
        rows, count = slice(starts[p], starts[p + 1]), len(own_functions)
        # A piece has as many orthonormal functions as points; each combines as many of the first series functions.
        matrix = np.zeros((SPACE_FUNCTIONS, count))
        matrix[:count] = np.linalg.lstsq(series[rows, :count], own_functions.T, rcond=None)[0]
        matrix = to_paper_space @ matrix
        own = found[coefficient_starts[p] : coefficient_starts[p + 1]]
        # c_w1 to c_w32 of Eq. 17, for each axis.
        coefficients[p] = np.einsum("pa,bax,qb->xpq", to_paper_time, own, matrix, optimize=True)
        condition[p] = time_condition * np.linalg.cond(matrix)
    return PaperForm(
        coefficients=coefficients,
        condition=condition,
        order=order,
        starts=starts,
        reference=reference.points[order],
        u=u,
        alpha=time_form.alpha,
        r=form.rate,
        times=time_form.times,
        centre=time_form.centre,
        half_length=time_form.half_length,
        first_frame=first_frame,
    )
