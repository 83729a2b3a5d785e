"""Stability of the fit of Eq. 25 over alpha and r: condition numbers, and the error of each solver in both
precisions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mpmath
import numpy as np
from mpmath import mpf
from numpy.typing import NDArray

from pdecodec.mesh.arrays import BoolArray, Float64Array
from pdecodec.report.charts.figure import Figure, Table
from pdecodec.report.charts.plots import (
    BLUE,
    DOTTED,
    GREEN,
    GREY,
    ORANGE,
    ORANGES,
    PURPLE,
    Axis,
    Panel,
    edges,
    side_by_side,
)
from pdecodec.report.charts.vegalite import WIDTH
from pdecodec.research.reproduction.functions import (
    SPACE_FUNCTIONS,
    TIME_FUNCTIONS,
    printed_functions,
    space_functions,
    time_functions,
    unit_basis,
)

FloatArray = NDArray[np.floating[Any]]

SMALLEST, LARGEST = 1e-6, 30.0

RIDGE_FRACTION = {np.dtype(np.float64): 1e-12, np.dtype(np.float32): 1e-6}
"""Fraction of the largest eigenvalue that ridge regression adds: a few digits above rounding."""

EXACT_DIGITS = 80
"""Decimal digits of the exact fit; the printed columns lose up to 42 digits at the smallest rates."""

MEASURABLE_CONDITION = 1e20
"""Above this condition number of the 32 columns, the factors' own condition numbers are near rounding."""

FAILURE_ERROR_RATIO = 2.0
"""A solver fails where its error is this many times that of the exact minimiser."""

PRECISIONS: dict[str, type[Any]] = {"float64": np.float64, "float32": np.float32}


def normal_equations(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """Solve the normal equations as printed in Eq. 25: ``A^T A c = A^T w``."""
    return np.asarray(np.linalg.solve(columns.T @ columns, columns.T @ wanted))


def ridge(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """Solve the normal equations with a small multiple of the unit matrix added."""
    matrix = columns.T @ columns
    if not np.isfinite(matrix).all():
        raise np.linalg.LinAlgError("the squares of the columns overflow")
    extra = RIDGE_FRACTION[columns.dtype] * np.linalg.norm(matrix, 2)
    identity = np.eye(len(matrix), dtype=columns.dtype)
    return np.asarray(np.linalg.solve(matrix + extra.astype(columns.dtype) * identity, columns.T @ wanted))


def qr(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """Solve by orthogonal factorisation without pivoting."""
    orthogonal, triangle = np.linalg.qr(columns)
    return np.asarray(np.linalg.solve(triangle, orthogonal.T @ wanted))


def svd(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """Solve by singular values, without those below rounding: the shortest of all minimisers."""
    return np.asarray(np.linalg.lstsq(columns, wanted, rcond=None)[0])


PRINTED_SOLVERS: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "normal equations": normal_equations,
    "ridge": ridge,
    "QR": qr,
    "SVD": svd,
}
"""Solvers of the 32 printed columns, by name."""

WELL_CONDITIONED = "well-conditioned basis"

NAMES = (*PRINTED_SOLVERS, WELL_CONDITIONED)

SOLVER_COLOURS = dict(zip(NAMES, (ORANGE, PURPLE, GREEN, GREY, BLUE), strict=True))


class TensorFit:
    """Fit of ``w(u, t)`` on a grid of parameters and times in [0, 1].

    The fit uses the frames marked as keyframes, (frames,) bool.
    """

    def __init__(self, u: Float64Array, times: Float64Array, keyframes: BoolArray) -> None:
        self.u, self.times, self.keyframes = u, times, keyframes

    def solve(self, name: str, wanted: Float64Array, alpha: float, r: float, dtype: type[Any]) -> Float64Array:
        """Return the fitted values at all times, (frames, points); NaN where the solver gives up.

        Parameters
        ----------
        name : str
            One of :data:`NAMES`.
        wanted : (frames, points) float64
        alpha, r : float
            Rates over t and u in [0, 1].
        dtype : type
            np.float64 or np.float32: precision of the columns and of all arithmetic. The columns are rounded to it.
        """
        if name == WELL_CONDITIONED:
            return self._well_conditioned(wanted, alpha, r, dtype)
        columns = printed_functions(self.u[None, :], self.times[:, None], alpha, r).astype(dtype)
        rows = columns[self.keyframes].reshape(-1, columns.shape[-1])
        try:
            with np.errstate(all="ignore"):
                solution = PRINTED_SOLVERS[name](rows, wanted[self.keyframes].reshape(-1).astype(dtype))
                return np.asarray(columns @ solution, dtype=np.float64)
        except np.linalg.LinAlgError:
            return np.full(wanted.shape, np.nan)

    def _well_conditioned(self, wanted: Float64Array, alpha: float, r: float, dtype: type[Any]) -> Float64Array:
        in_time = unit_basis(self.times, alpha, TIME_FUNCTIONS).astype(dtype)
        in_space = unit_basis(self.u, r, SPACE_FUNCTIONS).astype(dtype)
        _, time_triangle = np.linalg.qr(in_time[self.keyframes])
        orthonormal, _ = np.linalg.qr(in_space)
        psi = np.linalg.solve(time_triangle.T, in_time.T).T  # orthonormal over the keyframes
        data = wanted.astype(dtype)
        coefficients = psi[self.keyframes].T @ data[self.keyframes] @ orthonormal
        return np.asarray(psi @ coefficients @ orthonormal.T, dtype=np.float64)


def keyframe_times(frames: int = 11) -> tuple[Float64Array, BoolArray]:
    """Return times in [0, 1], and which of them are keyframes: every second one."""
    return np.linspace(0.0, 1.0, frames), np.arange(frames) % 2 == 0


def motion(u: Float64Array, times: Float64Array) -> Float64Array:
    """Return a smooth motion that no space of Eq. 18 contains, (frames, points): bending waves over a slow drift."""
    grid_u, grid_t = u[None, :], times[:, None]
    return np.asarray(0.4 * np.sin(5.0 * grid_u - 2.5 * grid_t) + 0.6 * grid_t**2 * grid_u + 0.2 * np.cos(9.0 * grid_u))


def sample_fit(points: int) -> tuple[TensorFit, Float64Array]:
    """Return the fit of the test motion at `points` points, and the motion, (frames, points)."""
    u = np.linspace(0.0, 1.0, points)
    times, is_key = keyframe_times()
    return TensorFit(u, times, is_key), motion(u, times)


def relative_error(found: Float64Array, wanted: Float64Array) -> float:
    """Return root mean square error over root mean square of `wanted`; infinite where it is not a number."""
    error = float(np.sqrt(((found - wanted) ** 2).mean() / (wanted**2).mean()))
    return error if np.isfinite(error) else float("inf")


def condition_numbers(rate: float, points: int = 104) -> dict[str, float]:
    """Return condition numbers at alpha = r = rate. The 32 columns are a product, and so is their condition number."""
    times, is_key = keyframe_times()
    keys, u = times[is_key], np.linspace(0.0, 1.0, points)
    printed = _condition(time_functions(keys, rate)) * _condition(space_functions(u, rate))
    series = (unit_basis(keys, rate, TIME_FUNCTIONS), unit_basis(u, rate, SPACE_FUNCTIONS))
    # The square of the factor's condition number; computed from the product itself, it would saturate at rounding.
    return {
        "normal equations": printed**2,
        "32 printed columns": printed,
        WELL_CONDITIONED: _condition(series[0]) * _condition(series[1]),
        "orthonormal": 1.0,
    }


def _condition(columns: Float64Array) -> float:
    """Return the condition number of columns scaled to length 1; any solver removes the effect of lengths."""
    return float(np.linalg.cond(columns / np.linalg.norm(columns, axis=0)))


def condition_figure(count: int) -> Figure:
    """Chart how condition numbers grow as alpha and r approach 0, at `count` rates."""
    rates = np.geomspace(SMALLEST, LARGEST, count)
    each = [condition_numbers(float(rate)) for rate in rates]
    found = {name: np.array([item[name] for item in each]) for name in each[0]}
    # Per factor of ten in the rate, time loses three orders of magnitude and space seven: the slope well above
    # rounding.
    inner = (rates > 0.1) & (rates < 1.0)
    slope = np.polyfit(np.log10(rates[inner]), np.log10(found["32 printed columns"][inner]), 1)[0]
    colours = dict(zip(found, (ORANGE, PURPLE, BLUE, GREY), strict=True))
    no_digit = {name: float(1 / np.finfo(dtype).eps) for name, dtype in PRECISIONS.items()}

    x = Axis("alpha = r, over t and u in [0, 1]", SMALLEST, LARGEST, log=True)
    panel = Panel(x, Axis("condition number", 0.3, 1e40, log=True), width=WIDTH, height=320)
    panel.fails("fails", above=no_digit["float64"])
    # Where a factor's own condition number is at rounding, the line is only a lower limit and is dotted.
    known = found["32 printed columns"] < MEASURABLE_CONDITION
    for name, values in found.items():
        is_known = known | (name in (WELL_CONDITIONED, "orthonormal"))
        panel.line(rates, np.where(is_known, values, np.nan), colours[name], name=name)
        panel.line(rates, np.where(is_known, np.nan, values), colours[name], name=name, dashes=DOTTED)
    panel.ends([(LARGEST, float(values[-1]), name, colours[name]) for name, values in found.items()])
    for name, value in no_digit.items():
        panel.level(y=value)
        panel.text(1.3e-6, value, f"no digit left in {name} above", dy=-8)

    def largest(name: str) -> float:
        return float(rates[(found[name] > no_digit["float64"]) & (rates < 3)].max(initial=0.0))

    def at(rate: float) -> float:
        return float(found[WELL_CONDITIONED][np.argmin(np.abs(np.log(rates / rate)))])

    return Figure(
        name="fit-condition",
        title="Condition numbers as alpha and r go to 0",
        lesson=(
            f"The 32 printed columns grow dependent as the rates to the power {slope:.1f} (three for time, seven for "
            "space), and the normal equations square that: they have no digit left in float64 below a rate of "
            f"{largest('normal equations'):.2g}, the columns themselves below {largest('32 printed columns'):.2g}. The "
            f"well-conditioned basis of the same space has {found[WELL_CONDITIONED][0]:.2g} at the smallest rate and "
            f"{at(4.0):.2g} at 4; above about 10 it is the worse one ({at(24.0):.1g} at 24, where the format ends), "
            "since every function has the same leading exponential there."
        ),
        table=Table.from_columns({"rate": rates, **found}),
        chart=side_by_side(panel),
        consequence="it fits in the well-conditioned basis, orthonormalised with dependent functions dropped.",
    )


def error_figure(count: int, points: int) -> Figure:
    """Chart the errors of every solver along alpha = r, in both precisions."""
    rates = np.geomspace(SMALLEST, LARGEST, count)
    fit, wanted = sample_fit(points)
    errors = {
        (precision, name): np.array(
            [relative_error(fit.solve(name, wanted, rate, rate, dtype), wanted) for rate in rates.tolist()]
        )
        for precision, dtype in PRECISIONS.items()
        for name in NAMES
    }
    best = errors["float64", WELL_CONDITIONED]

    panels = []
    for precision in PRECISIONS:
        panel = Panel(
            Axis("alpha = r", SMALLEST, LARGEST, log=True),
            Axis("error at all frames, over the motion (rms)", 1e-3, 1e3, log=True),
            title=precision,
        )
        panel.fails(
            "fails: twice the exact minimiser's error", above=FAILURE_ERROR_RATIO * float(best[rates < 1].max())
        )
        for name, colour in SOLVER_COLOURS.items():
            width = 2.6 if name == WELL_CONDITIONED else 1.5
            panel.line(rates, np.minimum(errors[precision, name], 1e5), colour, name=name, width=width)
        panels.append(panel)
    panels[-1].legend(SOLVER_COLOURS)

    def failing_below(precision: str, name: str) -> float:
        return float(rates[(errors[precision, name] > FAILURE_ERROR_RATIO * best) & (rates < 3)].max(initial=0.0))

    return Figure(
        name="fit-error",
        title="What each solver makes of small and large rates",
        lesson=(
            "Fitted to the keyframes of a smooth motion and measured at all frames. Below a rate of "
            f"{failing_below('float64', 'normal equations'):.2g} (float64) and "
            f"{failing_below('float32', 'normal equations'):.2g} (float32) the printed normal equations leave more "
            f"than twice the exact minimiser's error; QR below {failing_below('float64', 'QR'):.2g} and "
            f"{failing_below('float32', 'QR'):.2g}. SVD and ridge survive by leaving functions out, and lose accuracy "
            "by it. The well-conditioned basis is exact in both down to 0. Above about 5 all fail alike: the "
            "functions themselves no longer fit."
        ),
        table=Table.from_columns(
            {"rate": rates, **{f"{name}, {precision}": values for (precision, name), values in errors.items()}}
        ),
        chart=side_by_side(*panels),
        consequence="the well-conditioned basis, in float64, whatever the rates.",
    )


def exact_errors(fit: TensorFit, wanted: Float64Array, rates: Float64Array) -> Float64Array:
    """Return errors of the exact minimiser of Eq. 25 over alpha and r, (rates, rates), from printed functions in many
    digits.

    The 32 functions are products, so the projection on them is too: one in time for each alpha, one in u for each r.
    """
    in_time = [_exact_columns(_printed_time, fit.times, fit.keyframes, rate) for rate in rates.tolist()]
    along = [_exact_columns(_printed_space, fit.u, np.ones(fit.u.size, bool), rate) for rate in rates.tolist()]
    return np.array(
        [
            [
                relative_error(psi @ (psi[fit.keyframes].T @ wanted[fit.keyframes] @ phi) @ phi.T, wanted)
                for phi in along
            ]
            for psi in in_time
        ]
    )


def _printed_time(t: mpf, alpha: mpf) -> list[mpf]:
    """Eq. 12."""
    return [mpmath.exp(alpha * t), mpmath.exp(-alpha * t), mpmath.sin(alpha * t), mpmath.cos(alpha * t)]


def _printed_space(u: mpf, r: mpf) -> list[mpf]:
    """Eqs. 14 and 16."""
    s = r / mpmath.sqrt(2) * u
    grow, fade, sine, cosine = mpmath.exp(s), mpmath.exp(-s), mpmath.sin(s), mpmath.cos(s)
    return [*_printed_time(u, r), grow * sine, grow * cosine, fade * sine, fade * cosine]


def _exact_columns(
    functions: Callable[[mpf, mpf], list[mpf]], x: Float64Array, known: BoolArray, rate: float
) -> Float64Array:
    """Orthonormalise functions over the known samples by Gram-Schmidt; return them at all x, (x, functions)."""
    with mpmath.workdps(EXACT_DIGITS):
        columns = np.array([functions(mpf(value), mpf(rate)) for value in x.tolist()], dtype=object)
        for i in range(columns.shape[1]):
            for j in range(i):
                columns[:, i] -= (columns[known, i] * columns[known, j]).sum() * columns[:, j]
            columns[:, i] /= mpmath.sqrt((columns[known, i] ** 2).sum())
        return columns.astype(np.float64)


def map_figure(count: int, points: int) -> Figure:
    """Chart the errors of every solver over alpha and r, divided by those of the exact minimiser."""
    rates = np.geomspace(SMALLEST, LARGEST, count)
    fit, wanted = sample_fit(points)
    best = exact_errors(fit, wanted, rates).ravel()
    alphas, rs = (axis.ravel() for axis in np.meshgrid(rates, rates, indexing="ij"))

    def errors(name: str, dtype: type[Any]) -> Float64Array:
        pairs = zip(alphas.tolist(), rs.tolist(), strict=True)
        return np.array([relative_error(fit.solve(name, wanted, *pair, dtype), wanted) for pair in pairs])

    found = {(precision, name): errors(name, dtype) / best for precision, dtype in PRECISIONS.items() for name in NAMES}

    at = edges(rates, log=True)
    axis = Axis("", at[0], at[-1], log=True, ticks=(1e-6, 1e-4, 1e-2, 1.0), grid=False)
    title, marks = "error over the\nexact minimiser's", dict(enumerate(("1", "10", "100", "1e3", "1e4")))
    panels = []
    for (precision, name), values in found.items():
        is_first = precision == "float64"
        x = replace(axis, title="" if is_first else "r")
        y = replace(axis, title=f"{precision}\nalpha" if name == NAMES[0] else "")
        panel = Panel(x, y, title=name if is_first else "", width=150, height=150)
        ratio = np.clip(values, 1.0, 1e4).reshape(count, count)
        panel.cells(at, at, np.log10(ratio), colours=ORANGES, low=0, high=4, title=title, marks=marks)
        panel.borders(at, at, ratio > FAILURE_ERROR_RATIO)
        panels.append(panel)

    shares = {key: float((values > FAILURE_ERROR_RATIO).mean()) for key, values in found.items()}
    return Figure(
        name="fit-maps",
        title="Over alpha and r from 1e-6 to 30",
        lesson=(
            "The exact minimiser is that of the printed functions, orthonormalised with 80 digits. Left and "
            "below the black line a solver leaves more than twice the exact minimiser's error: the printed "
            f"normal equations on {shares['float64', 'normal equations']:.0%} of the map in float64 and "
            f"{shares['float32', 'normal equations']:.0%} in float32, QR on {shares['float64', 'QR']:.0%} and "
            f"{shares['float32', 'QR']:.0%}, the well-conditioned basis on {shares['float64', WELL_CONDITIONED]:.0%} "
            f"and {shares['float32', WELL_CONDITIONED]:.0%}."
        ),
        table=Table.from_columns(
            {
                "alpha": alphas,
                "r": rs,
                "exact error": best,
                **{f"{name}, {precision}, over exact": values for (precision, name), values in found.items()},
            }
        ),
        chart=side_by_side(*panels, columns=len(NAMES)),
    )
