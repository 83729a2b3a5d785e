"""Find the fewest bytes with which a baseline stays within a maximum distance; every attempt is decoded again."""

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
"""A function from a length to the positions that its bytes would decode to."""

MAX_TRIES = 8
"""Largest number of lengths tried per bound: a few approach the bound, but errors jump by 10 % from one length
to the next.
"""

ACCEPTED_RATIO = 0.98
"""A length whose error is within this fraction of the bound, or which is within this fraction of a neighbouring
length, is close enough: about 1 % of the bytes.
"""

TARGET_RATIO = 0.99
"""Fraction of the bound that a length aims at: the middle of what is close enough."""

MIN_SAVING_RATIO = 0.98
"""Between a length that misses the bound and one that keeps it, further lengths are tried only if the former
takes less than this fraction of the bytes of the latter.
"""

MAX_LENGTH_RATIO = 16.0
"""Largest factor between two lengths tried in a row: errors of small clips jump."""

SLOPE_BASE = math.log(1.5)
"""Smallest distance of two lengths, as logarithms, whose errors give a slope."""

SLOPES = (0.5, 1.5)
"""Plausible slopes: the error is about proportional to the length."""

MIN_BRACKET_FRACTION = 0.1
"""Smallest distance of an interpolated length from the ends of a bracket, over its width on a log scale."""

INTERPOLATIONS = 3
"""Largest number of interpolated lengths in a bracket. If these do not come close, the error jumps, and
bisection is better.
"""


@dataclass(frozen=True)
class SearchResult:
    """One encode of a baseline, decoded again.

    Bytes without the connectivity, the length given to the encoder [scene units], the error of the decoded
    positions, and the seconds of that one encode, preparation included, and of that one decode.
    """

    size: int
    length: float
    distortion: Distortion
    encode_seconds: float
    decode_seconds: float
    data: bytes = field(repr=False)


class RateCurve:
    """Bytes against error of one baseline on one sequence. It is prepared once, and every length tried serves every
    bound.

    For a :class:`Transform`, a length is tried by computing what it would decode to; only the chosen length is
    coded. Results were always coded and decoded. Nothing is done before the first bound is requested.

    The same bounds in the same order give the same results. In another order, if two lengths are close enough to the
    bound, the other one may be chosen, whose bytes differ by about 1 %. Raises MissingExtraError if the baseline's
    package is missing.
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
        """Return the smallest encoding found whose largest Euclidean vertex distance is at most `bound`.

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
        """Decode the bytes of a result, (frames, vertices, 3) float32 [scene units]."""
        return self._baseline.decode(result.data, self._connectivity)

    def _search(self, bound: float) -> None:
        """Find a length for a bound and encode with it, if there is one."""
        self._prepare()
        try:
            for count in range(MAX_TRIES):
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
        """Return the next length to try for a bound after `count` tries; None if no length is worth a try."""
        if not self._baseline.adjustable:
            return None if self._errors else bound
        if bound <= 0.0:
            return None
        coarsest = max((length for length, error in self._errors.items() if error <= bound), default=None)
        finest = min((length for length, error in self._errors.items() if error > bound), default=None)
        if coarsest is not None and self._errors[coarsest] >= ACCEPTED_RATIO * bound:
            return None
        if coarsest is not None and finest is not None:
            if coarsest >= ACCEPTED_RATIO * finest or self._saves_little(coarsest, finest):
                return None
            length = self._baseline.effective_length(
                math.sqrt(coarsest * finest) if count >= INTERPOLATIONS else self._between(coarsest, finest, bound)
            )
            if length in self._errors:  # for a baseline that distinguishes only powers of two
                length = self._baseline.effective_length(2.0 * coarsest)
            return None if length in self._errors or length > finest else length
        near = finest if coarsest is None else coarsest
        if near is None:
            return self._baseline.effective_length(bound)
        if self._errors[near] == 0.0:  # no slope to use; most baselines keep a length equal to the bound
            length = self._baseline.effective_length(bound)
            return length if length > near else None
        factor = (TARGET_RATIO * bound / self._errors[near]) ** (1.0 / self._slope(near))
        length = near * min(max(factor, 1.0 / MAX_LENGTH_RATIO), MAX_LENGTH_RATIO)
        if count == 0 and ACCEPTED_RATIO <= length / bound <= 1.0 / ACCEPTED_RATIO:
            length = bound
        length = self._baseline.effective_length(length)
        return length if length != near else self._baseline.effective_length(near * (0.5 if coarsest is None else 2.0))

    def _saves_little(self, within: float, beyond: float) -> bool:
        """Return whether the length that misses a bound is known to save hardly any bytes over the one that
        keeps it.
        """
        if within not in self._tries or beyond not in self._tries:
            return False
        return self._tries[beyond].size >= MIN_SAVING_RATIO * self._tries[within].size

    def _between(self, within: float, beyond: float, bound: float) -> float:
        """Interpolate a length between two others, on logarithmic scales."""
        least, largest = self._errors[within], self._errors[beyond]
        share = math.log(TARGET_RATIO * bound / least) / math.log(largest / least) if least > 0.0 else 0.5
        share = min(max(share, MIN_BRACKET_FRACTION), 1.0 - MIN_BRACKET_FRACTION)
        return within * math.exp(share * math.log(beyond / within))

    def _slope(self, near: float) -> float:
        """Return the slope of the logarithm of the error over that of the length at a try; 1 if no other try tells."""
        logarithms = [
            (math.log(length / near), math.log(error / self._errors[near]))
            for length, error in self._errors.items()
            if error > 0.0
        ]
        apart = [each for each in logarithms if abs(each[0]) >= SLOPE_BASE]
        run, rise = min(apart, key=lambda each: abs(each[0]), default=(1.0, 1.0))
        return min(max(rise / run, SLOPES[0]), SLOPES[1])


def largest_distance(points: Float32Array, decoded: Float32Array) -> float:
    """Return the largest Euclidean distance [scene units] between two (frames, vertices, 3) float32 arrays."""
    missing = points.astype(np.float64) - decoded
    return math.sqrt(float(np.einsum("fvk,fvk->fv", missing, missing).max()))


def _distortion(points: Float32Array, decoded: Float32Array) -> Distortion:
    if decoded.dtype != np.float32:
        raise TypeError(f"a baseline gave {decoded.dtype}, not float32")
    meter = DistortionMeter()
    meter.add(points, decoded)
    return meter.result()
