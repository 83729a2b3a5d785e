"""Equal error: the fewest bytes with which a baseline stays within a maximum distance, each try decoded again."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.metrics import Distortion, DistortionMeter
from pdecodec.mesh.sequence import Connectivity
from pdecodec.report.clips.baseline import Baseline, Encoder, Transform, UnreachableError

Preview = Callable[[float], Float32Array]
"""From a length to what its bytes would decode to."""

MOST_TRIES = 8
"""Lengths that one bound may take: a few go towards it, and errors jump by 10 % from one length to the next."""

CLOSE_ENOUGH = 0.98
"""Share of the bound that need not be improved on, and of neighbouring lengths: about 1 % of the bytes."""

AIM = 0.99
"""Share of the bound that a try is aimed at: the middle of what is close enough."""

WORTH_A_TRY = 0.98
"""Share of the bytes that a try beyond the bound must be below, for lengths between it and the bound to be tried."""

FARTHEST_STEP = 16.0
"""Factor by which one step may change the length: errors of small clips jump."""

SLOPE_BASE = math.log(1.5)
"""Least distance of two lengths, as logarithms, whose errors tell a slope."""

SLOPES = (0.5, 1.5)
"""Range of slopes that are believed: the error is about proportional to the length."""

LEAST_SHARE = 0.1
"""Of a bracket's width, on a log scale: how near to its ends interpolation may go."""

INTERPOLATIONS = 3
"""Tries that follow interpolation in a bracket; where they do not come close errors jump, and halves do better."""


@dataclass(frozen=True)
class SearchResult:
    """One encode of a baseline, decoded again: bytes without the connectivity, the length its encoder was given [scene
    units], how far off what came back is, and seconds of that one encode, preparation included, and that one decode.
    """

    size: int
    length: float
    distortion: Distortion
    encode_seconds: float
    decode_seconds: float
    data: bytes = field(repr=False)


class RateCurve:
    """Bytes against error of one baseline on one sequence: prepared once, and every length tried serves every bound.

    Of a :class:`Transform` lengths are tried by what they would decode to, and only the one chosen is coded. What is
    given back was always coded and decoded again. Nothing is done before the first bound is asked for.

    The same bounds in the same order give the same results. In another order a length may differ where two are close
    enough to the bound, and the bytes with it by about 1 %. MissingExtraError is raised if the baseline's package is
    not installed.
    """

    def __init__(self, baseline: Baseline, points: Float32Array, connectivity: Connectivity) -> None:
        baseline.require()
        self._baseline = baseline
        self._points = points
        self._connectivity = connectivity
        self._encode: Encoder | None = None
        self._preview: Preview | None = None
        self._prepare_seconds = 0.0
        self._errors: dict[float, float] = {}
        self._tries: dict[float, SearchResult] = {}

    @property
    def tries(self) -> tuple[SearchResult, ...]:
        """All encodes made so far, the shortest length first: points of the curve."""
        return tuple(self._tries[length] for length in sorted(self._tries))

    def reach(self, bound: float) -> SearchResult:
        """The smallest encoding found whose largest Euclidean vertex distance is at most `bound`.

        Parameters
        ----------
        bound : float [scene units]

        Raises
        ------
        UnreachableError
            If nothing tried stays within the bound.
        """
        reason = ""
        try:
            self._search(bound)
        except UnreachableError as refusal:
            reason = str(refusal)
        able = [made for made in self._tries.values() if made.distortion.max_error <= bound]
        if not able:
            least = min(self._errors.values(), default=math.inf)
            reason = reason or f"its error is {least:.3g} where {bound:.3g} is allowed"
            raise UnreachableError(f"{self._baseline.name}: {reason}")
        return min(able, key=lambda made: made.size)

    def decode(self, result: SearchResult) -> Float32Array:
        """What the bytes of a result decode to, (frames, vertices, 3) float32 [scene units]."""
        return self._baseline.decode(result.data, self._connectivity)

    def _search(self, bound: float) -> None:
        """Find a length for a bound and encode with it, where there is one."""
        self._prepare()
        try:
            for count in range(MOST_TRIES):
                length = self._next_length(bound, count)
                if length is None:
                    break
                if self._preview is None:
                    self._try(length)
                else:
                    self._errors[length] = largest_distance(self._points, self._preview(length))
        finally:
            coarsest = max((length for length, error in self._errors.items() if error <= bound), default=None)
            if coarsest is not None and coarsest not in self._tries:
                self._try(coarsest)

    def _prepare(self) -> None:
        if self._encode is not None:
            return
        started = time.perf_counter()
        baseline, connectivity = self._baseline, self._connectivity
        if isinstance(baseline, Transform):
            round_to = baseline.analyse(self._points, connectivity)
            self._encode = lambda length: baseline.write(round_to(length), connectivity)
            self._preview = lambda length: baseline.synthesise(round_to(length), connectivity)
        else:
            self._encode = baseline.prepare(self._points, connectivity)
        self._prepare_seconds = time.perf_counter() - started

    def _try(self, length: float) -> None:
        assert self._encode is not None
        started = time.perf_counter()
        data = self._encode(length)
        encoded = time.perf_counter()
        decoded = self._baseline.decode(data, self._connectivity)
        decode_seconds = time.perf_counter() - encoded
        distortion = _distortion(self._points, decoded)
        self._errors[length] = distortion.max_error
        self._tries[length] = SearchResult(
            size=len(data),
            length=length,
            distortion=distortion,
            encode_seconds=self._prepare_seconds + encoded - started,
            decode_seconds=decode_seconds,
            data=data,
        )

    def _next_length(self, bound: float, count: int) -> float | None:
        """What to try next for a bound after `count` tries for it; None where no length is worth a try."""
        if not self._baseline.adjustable:
            return None if self._errors else bound
        if bound <= 0.0:
            return None
        coarsest = max((length for length, error in self._errors.items() if error <= bound), default=None)
        finest = min((length for length, error in self._errors.items() if error > bound), default=None)
        if coarsest is not None and self._errors[coarsest] >= CLOSE_ENOUGH * bound:
            return None
        if coarsest is not None and finest is not None:
            if coarsest >= CLOSE_ENOUGH * finest or self._saves_little(coarsest, finest):
                return None
            length = self._baseline.effective_length(
                math.sqrt(coarsest * finest) if count >= INTERPOLATIONS else self._between(coarsest, finest, bound)
            )
            if length in self._errors:  # of a baseline that sees powers of two alone
                length = self._baseline.effective_length(2.0 * coarsest)
            return None if length in self._errors or length > finest else length
        near = finest if coarsest is None else coarsest
        if near is None:
            return self._baseline.effective_length(bound)
        if self._errors[near] == 0.0:  # nothing to go by; the bound is a length that most baselines keep
            length = self._baseline.effective_length(bound)
            return length if length > near else None
        factor = (AIM * bound / self._errors[near]) ** (1.0 / self._slope(near))
        length = near * min(max(factor, 1.0 / FARTHEST_STEP), FARTHEST_STEP)
        if count == 0 and CLOSE_ENOUGH <= length / bound <= 1.0 / CLOSE_ENOUGH:
            length = bound
        length = self._baseline.effective_length(length)
        return length if length != near else self._baseline.effective_length(near * (0.5 if coarsest is None else 2.0))

    def _saves_little(self, within: float, beyond: float) -> bool:
        """Whether a length that misses the bound is known to take hardly fewer bytes than one that keeps it."""
        if within not in self._tries or beyond not in self._tries:
            return False
        return self._tries[beyond].size >= WORTH_A_TRY * self._tries[within].size

    def _between(self, within: float, beyond: float, bound: float) -> float:
        """A length by interpolation, both axes logarithmic."""
        least, largest = self._errors[within], self._errors[beyond]
        share = math.log(AIM * bound / least) / math.log(largest / least) if least > 0.0 else 0.5
        share = min(max(share, LEAST_SHARE), 1.0 - LEAST_SHARE)
        return within * math.exp(share * math.log(beyond / within))

    def _slope(self, near: float) -> float:
        """Of the logarithm of the error over that of the length, at a try; 1 where no other one tells."""
        logarithms = [
            (math.log(length / near), math.log(error / self._errors[near]))
            for length, error in self._errors.items()
            if error > 0.0
        ]
        apart = [each for each in logarithms if abs(each[0]) >= SLOPE_BASE]
        run, rise = min(apart, key=lambda each: abs(each[0]), default=(1.0, 1.0))
        return min(max(rise / run, SLOPES[0]), SLOPES[1])


def largest_distance(points: Float32Array, decoded: Float32Array) -> float:
    """Largest Euclidean distance [scene units] of two (frames, vertices, 3) float32 arrays."""
    missing = points.astype(np.float64) - decoded
    return math.sqrt(float(np.einsum("fvk,fvk->fv", missing, missing).max()))


def _distortion(points: Float32Array, decoded: Float32Array) -> Distortion:
    if decoded.dtype != np.float32:
        raise TypeError(f"a baseline gave {decoded.dtype}, not float32")
    meter = DistortionMeter()
    meter.add(points, decoded)
    return meter.result()
