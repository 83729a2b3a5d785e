"""The paper's claims, one by one, each judged by the figures of one run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

from pdecodec.report.reproduction import bspline, printed
from pdecodec.report.reproduction.findings import Findings, reaches_table_1
from pdecodec.report.reproduction.functions import ROUNDING
from pdecodec.report.reproduction.method import PRINTED, RATES

Judgement = Literal["reproduced", "reproduced with a condition", "not reproduced"]

QUICK = 0.1
"""Share of the simulation's time under which a fit is called quick beside it."""

SAME_SHARE = 1.1
"""Errors within ten per cent of each other are called equal."""


class Verdict(NamedTuple):
    """A claim, what the paper prints for it, what this run found, the judgement, and why."""

    claim: str
    printed: str
    found: str
    judgement: Judgement
    why: str


def judge(findings: Findings) -> list[Verdict]:
    """Every claim in the order in which the paper makes it."""
    return [claim(findings) for claim in CLAIMS]


def _solutions(findings: Findings) -> Verdict:
    equation = findings.equation
    printed_count, beam, both = (
        int((part < ROUNDING).sum()) for part in (equation.printed, equation.beam, equation.squared)
    )
    return Verdict(
        "The 32 functions of Eq. 18 solve Eq. 10.",
        "32 of 32",
        f"{printed_count} of 32 solve m w_tt = K w_uuuu; the other {beam} solve m w_tt = -K w_uuuu; all {both} solve "
        "w_tttt = (K/m)^2 w_uuuuuuuu",
        "reproduced" if printed_count == 32 else "reproduced with a condition",
        "Products of growing and fading time with the damped functions of u have the sign of the Euler-Bernoulli "
        "beam, which Eq. 9 does not have. The equation that all of them solve is Eq. 10 applied twice.",
    )


def _accuracy(findings: Findings) -> Verdict:
    found, honest = findings.printed_first, findings.honest_first
    return Verdict(
        "PDE reconstruction is accurate to 0.0070 of D on average and 0.0195 at most (Table 1).",
        f"mean E_A {printed.PDE_MEAN}, largest E_M {printed.PDE_LARGEST}",
        f"as printed, alpha = {PRINTED.alpha:g}, r = {PRINTED.r:g}: {found.mean:.4f} and {found.largest:.4f}; with a "
        f"u that a decoder can know: {honest.mean:.4f} and {honest.largest:.4f}",
        "reproduced with a condition" if reaches_table_1(found) else "not reproduced",
        "The condition: the decoder is given the curve. u of Eq. 24 is each coordinate scaled to [0, 1], at every "
        "frame, those between the keyframes too; and errors are measured after Eq. 23, whose matrices are not undone.",
    )


def _better_than_splines(findings: Findings) -> Verdict:
    literal, fair, equal = (
        findings.spline(reading).first for reading in (bspline.printed, bspline.fair, bspline.equal_numbers)
    )
    honest = findings.honest_first
    is_better = honest.mean < fair.mean and honest.largest < fair.largest
    return Verdict(
        "It outperforms B-splines with linear interpolation: 6.68 times by average, 13.91 times by maximum.",
        f"B-splines: mean E_A {printed.SPLINE_MEAN}, largest E_M {printed.SPLINE_LARGEST}",
        f"fitted by index and evaluated at u of Eq. 24: {literal.mean:.4f} and {literal.largest:.4f}; fitted and "
        f"evaluated at one parameter: {fair.mean:.4f} and {fair.largest:.4f}; with 32 constants: {equal.mean:.4f} and "
        f"{equal.largest:.4f}. PDE, u known: {honest.mean:.4f} and {honest.largest:.4f}",
        "reproduced" if is_better else "not reproduced",
        "Errors like those printed appear when a spline is evaluated at another parameter than it was fitted by, as "
        "the text below Eq. 27 says. Fitted and evaluated at one parameter they spend "
        f"{findings.spline(bspline.fair).control_points / printed.FUNCTIONS:.0f} times the constants of Eq. 17 on the "
        "errors above; a spline surface of as many constants as Eq. 17 has the errors of Eq. 17.",
    )


def _variables(findings: Findings) -> Verdict:
    raw, literal, honest = findings.stores[:3]
    share = printed.VARIABLES_PDE / printed.VARIABLES_XPBD
    return Verdict(
        "768 design variables stand for 219,648: 0.35 %.",
        f"{printed.VARIABLES_PDE} of {printed.VARIABLES_XPBD:,}",
        f"{literal.variables} of {raw.variables:,} ({share:.2%}) are counted. As printed the decoder needs "
        f"{literal.total:,} bytes, {literal.total / raw.total:.1%} of the raw positions; with u from the reference "
        f"frame {honest.total:,} bytes, {honest.total / raw.total:.1%}",
        "reproduced with a condition",
        "The count is right. u of Eq. 24 is as large as the clip and is not counted, nor are the transformations, "
        "nor the reference frame.",
    )


def _variables_against_splines(findings: Findings) -> Verdict:
    fair, equal = (findings.spline(reading).first for reading in (bspline.fair, bspline.equal_numbers))
    honest = findings.honest_first
    ratio = equal.mean / honest.mean
    return Verdict(
        "It needs 10.67 % of the design variables of B-splines.",
        f"{printed.VARIABLES_PDE} of {printed.VARIABLES_SPLINE:,}",
        f"{printed.VARIABLES_PDE / printed.VARIABLES_SPLINE:.2%} by count, at {honest.mean / fair.mean:.1f} times the "
        f"error; a spline surface of 8 x 4 control points has as few, at {ratio:.2f} times the error of the PDE",
        "reproduced with a condition",
        "The saving comes from 8 functions along the curve and 4 in time. Any smooth functions of that number do as "
        "well.",
    )


def _time(findings: Findings) -> Verdict:
    fine, sampled, doubled, _, coarse = findings.routes
    own = (printed.SECONDS_KEYFRAMES + printed.SECONDS_PDE) / printed.SECONDS_ALL_FRAMES
    return Verdict(
        "XPBD for the keyframes and the PDE for the rest take 58.13 % of XPBD's time.",
        f"58.13 %; the printed seconds give {own:.2%}",
        f"keyframes taken from the simulation: {sampled.seconds / fine.seconds:.0%}; simulated with a doubled step: "
        f"{doubled.seconds / fine.seconds:.0%}, mean E_A {doubled.errors.mean:.4f}; XPBD alone with that step, every "
        f"frame: {coarse.seconds / fine.seconds:.0%}, {coarse.errors.mean:.4f}",
        "reproduced with a condition" if doubled.seconds < fine.seconds else "not reproduced",
        "XPBD passes through every frame on its way to a keyframe; time is saved only by a longer step, and that "
        "step gives the frames between as well, at once and closer to the fine simulation than the fit does.",
    )


def _continuous(findings: Findings) -> Verdict:
    everywhere, _, rest, *_ = findings.rungs[1:]
    return Verdict(
        "It creates continuous shapes at times that XPBD does not simulate.",
        "stated",
        "Eq. 17 can be evaluated at any t, but u of Eq. 24 is not known there. With u of frame 0, the errors in the "
        f"scene go from {everywhere.scene.mean:.4f} to {rest.scene.mean:.4f}; with arc length they are "
        f"{findings.honest_every.mean:.4f}",
        "reproduced with a condition",
        "True of the functions of t. The parameter must be one that does not depend on the shape at t, such as the "
        "arc length of the reference frame.",
    )


def _physics(findings: Findings) -> Verdict:
    ratio = findings.polynomials_over_chosen
    chosen = findings.honest_chosen
    return Verdict(
        "The method is physics based: the PDE's functions carry the underlying deformation.",
        "stated",
        f"of alpha and r from 0 to {max(RATES):g} the keyframes choose {chosen.alpha:g} and {chosen.r:g}, where 0 "
        f"makes polynomials of degree 3 in t and 7 in u; the error is {1 / ratio:.3f} times that of polynomials",
        "reproduced" if ratio > SAME_SHARE else "not reproduced",
        "On this rope the physical functions do what polynomials do. K/m enters through alpha = r^2 sqrt(K/m) alone, "
        "and the paper gives neither alpha, r nor K/m.",
    )


def _rigid(findings: Findings) -> Verdict:
    values = findings.elimination.singular_values
    return Verdict(
        "Rigid transformations are removed by the rotation of Eqs. 20 to 23.",
        "a rotation matrix",
        f"singular values of Eq. 23's matrices from {values[1:].min():.2g} to {values.max():.2g}; "
        f"{1 - findings.elimination.motion_left[1:].mean():.0%} of the motion that Eq. 19 leaves goes with them",
        "not reproduced",
        "Eq. 23 puts no orthogonality on its matrix: it is an affine map. It takes deformation out along with the "
        "motion, flatters the errors measured after it, and cannot be undone where a singular value is near 0.",
    )


def _fit_time(findings: Findings) -> Verdict:
    fine, quick = findings.routes[0].seconds, findings.routes[1].fit_seconds
    share = findings.printed_fit_seconds / fine
    return Verdict(
        "The reconstruction itself is quick: 0.293 s for 24 curves.",
        f"{printed.SECONDS_PDE} s, {printed.SECONDS_PDE / printed.SECONDS_ALL_FRAMES:.1%} of XPBD's time",
        f"as printed {findings.printed_fit_seconds:.2f} s, {share:.1%} of XPBD's time; with one u for all axes and "
        f"frames {quick:.2f} s, {quick / fine:.1%}",
        "reproduced" if share < QUICK else "reproduced with a condition",
        "Small beside the simulation where all axes and frames share one u; u of Eq. 24 asks for a matrix of its own "
        "for each axis, three times as much.",
    )


CLAIMS: tuple[Callable[[Findings], Verdict], ...] = (
    _solutions,
    _rigid,
    _accuracy,
    _better_than_splines,
    _variables,
    _variables_against_splines,
    _time,
    _fit_time,
    _continuous,
    _physics,
)
"""In the order of the paper."""
