"""The chapter on the fit of Eq. 25."""

from __future__ import annotations

from pdecodec.experiments.exhibit import Chapter
from pdecodec.experiments.stability.fit_data import extrapolation, few, gaps, noise
from pdecodec.experiments.stability.fit_rates import condition, error_lines, error_maps


def fit_chapter(*, quick: bool) -> Chapter:
    """Every exhibit of the fit.

    Parameters
    ----------
    quick : bool
        Coarser axes.
    """
    return Chapter(
        "The fit",
        "Eq. 25 fits 32 functions by normal equations. The test motion is a bending wave over a drift, at 104 points "
        "and 11 frames of which every second is a keyframe; alpha and r are over t and u in [0, 1].",
        (
            condition(25 if quick else 97),
            error_lines(17 if quick else 73, 104),
            error_maps(7 if quick else 21, 52 if quick else 104),
            noise(16),
            few(104),
            gaps(17 if quick else 65),
            extrapolation(21 if quick else 81),
        ),
    )
