"""Every reading of the method beside the others: what is given, what is fitted, what is removed, which functions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pdecodec.experiments.reproduction.errors import FrameErrors, frame_errors
from pdecodec.experiments.reproduction.method import (
    Functions,
    Parameter,
    Removal,
    Target,
    Variant,
    choose_rates,
    reconstruct,
)

Float64Array = NDArray[np.float64]


@dataclass(frozen=True)
class Outcome:
    """What one variant gives.

    Attributes
    ----------
    variant : Variant
    rates_chosen : bool
        Whether alpha and r were chosen by the keyframes' error, or are the fixed ones.
    aligned, scene : FrameErrors
        As the paper measures; and decoded, in the scene, with the transformations of keyframes alone.
    """

    variant: Variant
    rates_chosen: bool
    aligned: FrameErrors
    scene: FrameErrors


PARAMETERS_COMPARED: tuple[Parameter, ...] = ("Eq. 24, every frame", "arc length of frame 0", "index")
TARGETS: tuple[Target, ...] = ("position", "displacement")
REMOVALS: tuple[Removal, ...] = ("none", "rotation", "Eq. 23")
FUNCTION_SETS: tuple[Functions, ...] = ("all 32", "16 that solve Eq. 10", "the other 16")


def every_variant(curve: Float64Array, diameter: float) -> list[Outcome]:
    """All combinations on one curve, each with fixed and with chosen rates.

    Parameters
    ----------
    curve : (frames, points, 3) float64 [m]
    diameter : float [m]
    """
    outcomes = []
    for parameter, target, removal, affine, functions in product(
        PARAMETERS_COMPARED, TARGETS, REMOVALS, (False, True), FUNCTION_SETS
    ):
        fixed = Variant(
            parameter=parameter, target=target, removal=removal, affine_functions=affine, functions=functions
        )
        for variant, is_chosen in ((fixed, False), (choose_rates(curve, fixed), True)):
            outcomes.append(_outcome(curve[None], variant, is_chosen, diameter))
    return outcomes


def _outcome(curves: Float64Array, variant: Variant, is_chosen: bool, diameter: float) -> Outcome:
    results = [reconstruct(curve, variant) for curve in curves]
    wanted, found, decoded = (
        np.stack([getattr(item, name) for item in results]) for name in ("wanted", "found", "decoded")
    )
    return Outcome(variant, is_chosen, frame_errors(wanted, found, diameter), frame_errors(curves, decoded, diameter))


def reconstruct_all(curves: Float64Array, variant: Variant, diameter: float) -> FrameErrors:
    """Errors of one variant over all curves, as the paper measures them."""
    return _outcome(curves, variant, False, diameter).aligned


def map_rates(
    curve: Float64Array, variant: Variant, rates: Float64Array, diameter: float
) -> tuple[Float64Array, Float64Array]:
    """Mean E_A and largest E_M over a grid of alpha (rows) and r (columns), (rates, rates) each."""
    mean, largest = np.empty((rates.size, rates.size)), np.empty((rates.size, rates.size))
    for i, alpha in enumerate(rates):
        for j, r in enumerate(rates):
            result = reconstruct(curve, replace(variant, alpha=float(alpha), r=float(r)))
            errors = frame_errors(result.wanted, result.found, diameter)
            mean[i, j], largest[i, j] = errors.mean, errors.largest
    return mean, largest
