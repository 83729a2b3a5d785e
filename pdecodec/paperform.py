"""A segment's coefficients as the paper writes them: c_w1 .. c_w32 of Eq. 17, for every curve piece and axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdecodec.basis import SPACE_FUNCTIONS, TIME_FUNCTIONS, paper_coefficients, series_functions
from pdecodec.elements import arc_length_parameter
from pdecodec.errors import SettingsError
from pdecodec.model import Model, SegmentCoefficients
from pdecodec.segments import Segment

Float64Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PaperForm:
    """Coefficients of Eq. 17 and what they multiply.

    Attributes
    ----------
    coefficients : (elements, 3, 4, 8) float64 [scene units]
        Element, axis, function of time (Eq. 12), function of space (Eqs. 14 and 16): c_w1 .. c_w32 in the
        paper's order are the last two axes, row after row. They give the displacement from the rest shape
        (under alignment "rotation": in the element's own frame).
    condition : (elements,) float64
        Condition number of each conversion: the digits that its coefficients have lost are its logarithm.
    alpha, r : float
        Rates over the arguments below.
    time : tuple of float [s]
        Centre and half-length of the segment: the argument t of Eq. 12 is (time - centre) / half-length.
    parameter : (vertices,) float64
        The argument u of Eqs. 14 and 16 of every vertex in curve order, in [-1, 1] along its element.
    """

    coefficients: Float64Array
    condition: Float64Array
    alpha: float
    r: float
    time: tuple[float, float]
    parameter: Float64Array


def paper_form(model: Model, segment: Segment, found: SegmentCoefficients, r: float) -> PaperForm:
    """Convert the coefficients of one segment.

    Parameters
    ----------
    model : Model
        Without the affine functions, which are not among those of Eq. 18.
    segment : Segment
    found : SegmentCoefficients
    r : float
        Rate of Eqs. 14 and 16.

    Raises
    ------
    SettingsError
        If the coefficients are not 32 of Eq. 18's functions: alpha or r is 0, pieces or segments are too
        short, or alignment is affine.
    """
    from pdecodec.kernels.orthonormal import DEPENDENT, orthonormalise

    elements = model.elements
    if model.alignment == "affine":
        raise SettingsError("the affine functions are not among the paper's; encode with alignment none or rotation")
    if segment.alpha == 0 or r == 0:
        raise SettingsError("at alpha or r of 0 the paper's functions are dependent; encode with both above 0")
    if segment.functions != TIME_FUNCTIONS or (elements.ranks != SPACE_FUNCTIONS).any():
        raise SettingsError("segments of 4 frames and pieces of 8 points are the least that 32 coefficients need")
    firsts = np.repeat(model.rest[elements.starts[:-1]], np.diff(elements.starts), axis=0)
    parameter = arc_length_parameter(model.rest - firsts, elements.starts)
    columns = series_functions(parameter, r, SPACE_FUNCTIONS)
    converted = np.empty((elements.count, 3, TIME_FUNCTIONS, SPACE_FUNCTIONS))
    condition = np.empty(elements.count)
    triangle, kept = np.empty((SPACE_FUNCTIONS, SPACE_FUNCTIONS)), np.empty(SPACE_FUNCTIONS, np.int64)
    shape = found.shape.reshape(elements.count, SPACE_FUNCTIONS, TIME_FUNCTIONS, 3).transpose(0, 3, 2, 1)
    for e in range(elements.count):
        rows = columns[elements.starts[e] : elements.starts[e + 1]]
        orthonormalise(rows, DEPENDENT, np.empty((SPACE_FUNCTIONS, len(rows))), triangle, kept)
        result = paper_coefficients(
            shape[e], alpha=segment.alpha, r=r, time_triangle=segment.triangle, space_triangle=triangle
        )
        converted[e], condition[e] = result.coefficients, result.condition
    return PaperForm(converted, condition, segment.alpha, r, (segment.centre, segment.half_length), parameter)
