"""Rate control: search for the tolerance whose file has a given size, mean error or error of normals.

Every step of the search is a whole encode, because only an encode tells the size of a file; a search takes at most
:data:`MAX_ENCODES` steps.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from numbers import Integral, Real
from typing import Any, TypeVar

from pdecodec.codec.encode.report import EncodeReport
from pdecodec.codec.settings import DEFAULT_TOLERANCE
from pdecodec.errors import SettingsError
from pdecodec.mesh.sequence import Progress
from pdecodec.system.arguments import as_number, shown

Outcome = TypeVar("Outcome")

FINEST = 1e-18
"""Finest tolerance that is tried: the float32 spacing of coordinates as small as a hundred-billionth of the
diagonal. Coarser tolerances already restore clips exactly.
"""

COARSEST = 1.0
"""Coarsest tolerance that is tried, at which vertices may be anywhere in the scene."""

MAX_ENCODES = 10
"""Largest number of encodes: six to bracket the limit from anywhere in the range, four to close in on it."""

CLOSE = 0.01
"""Share of a limit that may stay unused, or precision of the tolerance, at which the search ends."""

FIRST_STRIDE = math.log(4.0)
"""First step [log tolerance] away from a tolerance that misses the limit; each further step in the same
direction is twice as long.
"""

LEAST_MOVE = 0.1
"""Smallest distance of an interpolated tolerance from the ends of the bracket, as a share of the bracket;
nearer to an end it would hardly narrow the bracket.
"""

TOLERANCE_OVER_RMS = 2.5
"""Initial tolerance of the search for a mean error, divided by that error: profile "auto" leaves a mean error
of 0.3 to 0.5 of its bound.
"""

SMALLEST_VALUE = 1e-300
"""Value in place of an error of zero, which has no logarithm."""


@dataclass(frozen=True)
class RateLimit:
    """An upper limit on a measure of the report.

    Attributes
    ----------
    value : float
    measure : callable
        Returns the measure of a report.
    falls : bool
        Whether the measure falls as the tolerance grows: bytes do, errors do not.
    start : float
        The first tolerance to try.
    refusal : callable
        Returns the error message if no file keeps the limit, given the smallest value reached.
    coarsest : float
        No coarser tolerance is tried.
    close : float
        Share of the limit that may stay unused.
    """

    value: float
    measure: Callable[[EncodeReport], float]
    falls: bool
    start: float
    refusal: Callable[[float], str]
    coarsest: float = COARSEST
    close: float = CLOSE


def rate_limit(*, rms: float | None = None, size: int | None = None) -> RateLimit | None:
    """Return the limit that an encode must keep in addition to its settings, a mean error or a size; None if
    there is none.

    Parameters
    ----------
    rms : float or None
        Root mean square vertex distance over all frames, over the diagonal of frame 0's bounding box.
    size : int or None [bytes]

    Raises
    ------
    SettingsError
        If a limit is not positive.
    """
    if size is not None:
        check_positive("size", size, Integral, "whole number of bytes")
        return RateLimit(
            value=float(size),
            measure=lambda report: float(report.file_bytes),
            falls=True,
            start=DEFAULT_TOLERANCE,
            refusal=lambda least: (
                f"no tolerance up to {COARSEST:g} gives a file of {size} bytes: the smallest file takes {least:.0f}; "
                "allow as many, or encode less"
            ),
        )
    if rms is not None:
        check_positive("rms", rms, Real, "number")
        return RateLimit(
            value=float(rms),
            measure=lambda report: report.rms_error / report.scale,
            falls=False,
            start=TOLERANCE_OVER_RMS * rms,
            refusal=lambda least: (
                f"no tolerance down to {FINEST:g} gives an rms error of {rms:g} of the diagonal: the smallest is "
                f"{least:.3g}; allow as much"
            ),
        )
    return None


def check_positive(name: str, value: Any, kind: Any, noun: str) -> None:
    """Raise SettingsError unless `value` is a positive, finite number of a kind."""
    if not isinstance(value, kind) or not 0 < as_number(value, name) < math.inf:
        raise SettingsError(f"must be a positive {noun}, not {shown(value)}", setting=name)


def encode_within(
    limit: RateLimit, encode_at: Callable[[float, Progress | None], EncodeReport], progress: Progress | None
) -> EncodeReport:
    """Search for the tolerance whose file keeps a limit and uses it up.

    Parameters
    ----------
    limit : RateLimit
    encode_at : callable
        Encodes at a tolerance, without a path.
    progress : callable, optional

    Returns
    -------
    EncodeReport
        Describes the chosen file; `seconds` is the time of the whole search.

    Raises
    ------
    SettingsError
        If no tolerance from :data:`FINEST` to :data:`COARSEST` keeps the limit.
    """
    started = time.perf_counter()
    values: list[float] = []

    def measure(tolerance: float) -> tuple[EncodeReport, float]:
        report = encode_at(tolerance, _numbered(progress, len(values) + 1))
        values.append(limit.measure(report))
        return report, values[-1] / limit.value

    found = search_tolerance(
        measure,
        start=limit.start,
        falls=limit.falls,
        is_exact=lambda report: report.max_error == 0,
        coarsest=limit.coarsest,
        close=limit.close,
    )
    if found is None:
        raise SettingsError(limit.refusal(min(values)))
    return replace(found, seconds=time.perf_counter() - started)


def search_tolerance(
    measure: Callable[[float], tuple[Outcome, float]],
    *,
    start: float,
    falls: bool,
    is_exact: Callable[[Outcome], bool] = lambda _: False,
    coarsest: float = COARSEST,
    close: float = CLOSE,
) -> Outcome | None:
    """Return the outcome nearest to a limit among those that keep it, with at most :data:`MAX_ENCODES` measurements.

    Brackets the limit in growing strides. Then it interpolates on logarithmic scales, on which size and error over
    tolerance are nearly straight lines, and bisects if that narrows the bracket too little.

    Parameters
    ----------
    measure : callable
        Takes a tolerance; returns an outcome, and its value over the limit.
    start : float
        First tolerance, which is clamped to the range.
    falls : bool
        Whether the value falls as the tolerance grows: bytes do, errors do not.
    is_exact : callable, optional
        Whether an outcome has no error, so that nothing is gained by a finer tolerance.
    coarsest : float
        No coarser tolerance is tried.
    close : float
        The limit counts as met if it is kept and all but this share of it is used.

    Returns
    -------
    outcome or None
        None if no tolerance from :data:`FINEST` to `coarsest` keeps the limit.
    """
    ends = math.log(FINEST), math.log(coarsest)
    at = min(max(math.log(start), ends[0]), ends[1])
    stride = FIRST_STRIDE
    best: Outcome | None = None
    fine: tuple[float, float] | None = None
    coarse: tuple[float, float] | None = None
    last_width = math.inf
    for _ in range(MAX_ENCODES):
        outcome, share = measure(float(f"{math.exp(at):.4g}"))
        excess = math.log(max(share, SMALLEST_VALUE))
        if excess <= 0.0:
            best = outcome
            if excess > -close or (falls and is_exact(outcome)):
                break
        is_too_fine = (excess > 0.0) == falls
        if is_too_fine:
            fine = (at, excess)
        else:
            coarse = (at, excess)
        if fine is not None and coarse is not None:
            width = coarse[0] - fine[0]
            if width < close:
                break
            at = 0.5 * (fine[0] + coarse[0]) if width > 0.5 * last_width else _interpolated(fine, coarse, close)
            last_width = width
        else:
            if at == ends[is_too_fine]:
                break
            at = min(max(at + (stride if is_too_fine else -stride), ends[0]), ends[1])
            stride *= 2.0
    return best


def _interpolated(fine: tuple[float, float], coarse: tuple[float, float], close: float) -> float:
    """Return where the line through two points (log tolerance, log value over limit) passes just below the limit."""
    share = (fine[1] + 0.5 * close) / (fine[1] - coarse[1])
    return fine[0] + min(max(share, LEAST_MOVE), 1.0 - LEAST_MOVE) * (coarse[0] - fine[0])


def _numbered(progress: Progress | None, attempt: int) -> Progress | None:
    """Return the progress callback with the number of the encode in its text."""
    if progress is None:
        return None
    return lambda done, total, what: progress(done, total, f"{what}, attempt {attempt}")
