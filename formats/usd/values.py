"""Read values of USD attributes in time: samples, splines, or neither."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Ts


def value_at(attribute: Any, at: float | None) -> Any:
    """Return an attribute's value at a time code; if that is None, its first value that is not blocked."""
    if at is not None:
        return attribute.Get(at)
    codes = attribute.GetTimeSamples()
    if not codes:
        return attribute.Get()
    return next((found for code in codes if (found := attribute.Get(code)) is not None), None)


ALWAYS = (-np.inf, np.inf)
"""All time codes."""


def codes_within(attribute: Any, span: tuple[float, float]) -> list[float]:
    """Return the codes of an attribute's samples in a span, including its start but not its end."""
    return [code for code in attribute.GetTimeSamples() if span[0] <= code < span[1]]


def changes_with_time(attribute: Any, span: tuple[float, float] = ALWAYS) -> bool:
    """Return whether an attribute's values change with time: one sample, or equal samples, are constant."""
    if attribute.HasSpline():
        return True
    codes = codes_within(attribute, span)
    first = attribute.Get(codes[0]) if codes else None
    return any(not np.array_equal(np.asarray(attribute.Get(code)), np.asarray(first)) for code in codes[1:])


def spline_codes(attribute: Any, stage: Any) -> list[float]:
    """Return the time codes between which an attribute follows its spline; none if it has no spline.

    If the spline extends before its first knot or after its last one, the stage's range counts too.
    """
    if not attribute.HasSpline():
        return []
    spline = attribute.GetSpline()
    codes = [float(code) for code in spline.GetKnots()]
    if spline.HasInnerLoops():
        loop = spline.GetInnerLoopParams()
        length = loop.protoEnd - loop.protoStart
        codes += [loop.protoStart - loop.numPreLoops * length, loop.protoEnd + loop.numPostLoops * length]
    ends = (
        (spline.GetPreExtrapolation(), stage.HasAuthoredMetadata("startTimeCode"), stage.GetStartTimeCode()),
        (spline.GetPostExtrapolation(), stage.HasAuthoredMetadata("endTimeCode"), stage.GetEndTimeCode()),
    )
    still = (Ts.ExtrapHeld, Ts.ExtrapValueBlock)
    codes += [float(code) for outside, is_authored, code in ends if is_authored and outside.mode not in still]
    return sorted(codes)
