"""Equal error: the fewest bytes with which a peer stays within a maximum distance, each try decoded again."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from pdecodec.metrics import Distortion, DistortionMeter
from pdecodec.peers.peer import Encoder, Peer, UnreachableError
from pdecodec.sequence import Connectivity, Float32Array

MOST_TRIES = 6
"""Encodes that one bound may take: a few go towards it, and the error jumps about by 10 % from length to length."""

CLOSE_ENOUGH = 0.98
"""Share of the bound that need not be improved on, and of neighbouring lengths: about 1 % of the bytes."""

AIM = 0.99
"""Share of the bound that a try is aimed at: the middle of what is close enough."""

WORTH_A_TRY = 0.98
"""Share of the bytes that a coarser try must be below, though it misses the bound, for lengths before it to be tried."""

FARTHEST_STEP = 16.0
"""Factor by which one step may change the length: errors of small clips jump."""

SLOPE_BASE = math.log(1.5)
"""Least distance of two lengths, as logarithms, whose errors tell a slope."""

SLOPES = (0.5, 1.5)
"""Range of slopes that are believed: the error is about proportional to the length."""

LEAST_SHARE = 0.1
"""Of a bracket's width, on a log scale: how near to its ends interpolation may go."""

INTERPOLATIONS = 3
"""Tries within a bracket that follow interpolation; where these do not come close, errors jump, and halves do better."""


@dataclass(frozen=True)
class PeerResult:
    """One encode of a peer, decoded again.

    Attributes
    ----------
    peer : str
    size : int
        Bytes, all that its decoder needs but the connectivity.
    length : float [scene units]
        What its encoder was given.
    distortion : Distortion
        Of what came back from those bytes.
    encode_seconds, decode_seconds : float
        Of that one encode, preparation included, and of that one decode.
    """

    peer: str
    size: int
    length: float
    distortion: Distortion
    encode_seconds: float
    decode_seconds: float


class PeerCurve:
    """Bytes against error of one peer on one sequence: prepared once, and every try serves every bound.

    The same bounds asked for in the same order give the same results. In another order a length may differ where two
    are close enough to the bound, and the bytes with it by about 1 %.

    Parameters
    ----------
    peer : Peer
    points : (frames, vertices, 3) float32 [scene units]
    connectivity : Connectivity
        Nothing is done with them before the first bound is asked for.

    Raises
    ------
    MissingExtraError
        If the peer's package is not installed.
    """

    def __init__(self, peer: Peer, points: Float32Array, connectivity: Connectivity) -> None:
        peer.require()
        self._peer = peer
        self._points = points
        self._connectivity = connectivity
        self._encode: Encoder | None = None
        self._prepare_seconds = 0.0
        self._tries: list[PeerResult] = []

    @property
    def tries(self) -> tuple[PeerResult, ...]:
        """All encodes made so far, the shortest length first: points of the curve."""
        return tuple(sorted(self._tries, key=lambda made: made.length))

    def reach(self, bound: float) -> PeerResult:
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
        for count in range(MOST_TRIES):
            length = self._next_length(bound, count)
            if length is None:
                break
            try:
                self._try(length)
            except UnreachableError as refusal:
                reason = str(refusal)
                break
        within = [made for made in self._tries if made.distortion.max_error <= bound]
        if not within:
            least = min((made.distortion.max_error for made in self._tries), default=math.inf)
            reason = reason or f"its error is {least:.3g} where {bound:.3g} is allowed"
            raise UnreachableError(f"{self._peer.name}: {reason}")
        return min(within, key=lambda made: made.size)

    def _try(self, length: float) -> None:
        started = time.perf_counter()
        if self._encode is None:
            self._encode = self._peer.prepare(self._points, self._connectivity)
            self._prepare_seconds = time.perf_counter() - started
            started = time.perf_counter()
        data = self._encode(length)
        encoded = time.perf_counter()
        decoded = self._peer.decode(data, self._connectivity)
        decode_seconds = time.perf_counter() - encoded
        self._tries.append(
            PeerResult(
                peer=self._peer.name,
                size=len(data),
                length=length,
                distortion=_distortion(self._points, decoded),
                encode_seconds=self._prepare_seconds + encoded - started,
                decode_seconds=decode_seconds,
            )
        )

    def _next_length(self, bound: float, count: int) -> float | None:
        """What to try next for a bound after `count` tries for it; None where no length is worth a try."""
        if not self._peer.adjustable:
            return None if self._tries else bound
        if bound <= 0.0:
            return None
        within = [made for made in self._tries if made.distortion.max_error <= bound]
        beyond = [made for made in self._tries if made.distortion.max_error > bound]
        coarsest = max(within, key=lambda made: made.length, default=None)
        finest = min(beyond, key=lambda made: made.length, default=None)
        if any(made.distortion.max_error >= CLOSE_ENOUGH * bound for made in within):
            return None
        if coarsest is not None and finest is not None:
            smallest = min(made.size for made in within)
            if coarsest.length >= CLOSE_ENOUGH * finest.length or finest.size >= WORTH_A_TRY * smallest:
                return None
            length = self._peer.effective_length(_between(coarsest, finest, bound, halve=count >= INTERPOLATIONS))
            return None if length in (coarsest.length, finest.length) else length
        near = coarsest or finest
        if near is None:
            return self._peer.effective_length(bound)
        error = near.distortion.max_error
        if error == 0.0:  # nothing to go by; a bound is a length that most peers keep
            length = self._peer.effective_length(bound)
            return length if length > near.length else None
        factor = (AIM * bound / error) ** (1.0 / self._slope(near))
        factor = min(max(factor, 1.0 / FARTHEST_STEP), FARTHEST_STEP)
        length = near.length * factor
        if count == 0 and CLOSE_ENOUGH <= length / bound <= 1.0 / CLOSE_ENOUGH:
            length = bound  # which many peers are made to keep
        length = self._peer.effective_length(length)
        return length if length != near.length else self._peer.effective_length(near.length * (2.0 if within else 0.5))

    def _slope(self, near: PeerResult) -> float:
        """Of the logarithm of the error over that of the length, at a try; 1 where no other one tells."""
        apart = [(abs(math.log(made.length / near.length)), made) for made in self._tries]
        error, other = (
            near.distortion.max_error,
            min(
                (
                    (distance, made)
                    for distance, made in apart
                    if distance >= SLOPE_BASE and made.distortion.max_error > 0.0
                ),
                key=lambda each: each[0],
                default=(0.0, near),
            )[1],
        )
        if other is near:
            return 1.0
        slope = math.log(other.distortion.max_error / error) / math.log(other.length / near.length)
        return min(max(slope, SLOPES[0]), SLOPES[1])


def measure_peer(peer: Peer, points: Float32Array, connectivity: Connectivity, *, bound: float) -> PeerResult:
    """What :meth:`PeerCurve.reach` finds for a single bound."""
    return PeerCurve(peer, points, connectivity).reach(bound)


def _between(within: PeerResult, beyond: PeerResult, bound: float, *, halve: bool) -> float:
    """A length inside a bracket: by interpolation, both axes logarithmic, or in the middle."""
    share = 0.5
    if not halve and within.distortion.max_error > 0.0:
        error, largest = within.distortion.max_error, beyond.distortion.max_error
        share = math.log(AIM * bound / error) / math.log(largest / error)
        share = min(max(share, LEAST_SHARE), 1.0 - LEAST_SHARE)
    return float(within.length * (beyond.length / within.length) ** share)


def _distortion(points: Float32Array, decoded: Float32Array) -> Distortion:
    if decoded.dtype != np.float32:
        raise TypeError(f"a peer gave {decoded.dtype}, not float32")
    meter = DistortionMeter()
    meter.add(points, decoded)
    return meter.result()
