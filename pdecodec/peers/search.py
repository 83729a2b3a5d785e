"""Equal error: the fewest bytes with which a peer stays within a maximum distance, each try decoded again."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from pdecodec.metrics import Distortion, DistortionMeter
from pdecodec.peers.peer import Peer, UnreachableError
from pdecodec.sequence import Connectivity, Float32Array

MOST_TRIES = 12
"""Encodes of one search: the steps towards the bound take four, the bisection after them the rest."""

CLOSE_ENOUGH = 0.98
"""Share of the bound that need not be improved on, and of neighbouring lengths: about 1 % of the bytes."""

FARTHEST_STEP = 16.0
"""Factor by which one step may change the length: errors of small clips jump."""


@dataclass(frozen=True)
class PeerResult:
    """What a peer needs to stay within a bound.

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
    tries : int
        Encodes that the search took.
    """

    peer: str
    size: int
    length: float
    distortion: Distortion
    encode_seconds: float
    decode_seconds: float
    tries: int


def measure_peer(peer: Peer, points: Float32Array, connectivity: Connectivity, *, bound: float) -> PeerResult:
    """The smallest encoding found whose largest Euclidean vertex distance is at most `bound`.

    Parameters
    ----------
    peer : Peer
    points : (frames, vertices, 3) float32 [scene units]
    connectivity : Connectivity
    bound : float [scene units]

    Returns
    -------
    PeerResult

    Raises
    ------
    UnreachableError
        If nothing tried stays within the bound.
    MissingExtraError
        If the peer's package is not installed.
    """
    peer.require()
    started = time.perf_counter()
    encode = peer.prepare(points, connectivity)
    prepared = time.perf_counter() - started
    best: PeerResult | None = None
    reason = ""
    search = _LengthSearch(bound)
    for tries in range(1, MOST_TRIES + 1):
        started = time.perf_counter()
        try:
            data = encode(search.length)
        except UnreachableError as refusal:
            reason = str(refusal)
            break
        encoded = time.perf_counter()
        decoded = peer.decode(data, connectivity)
        decode_seconds = time.perf_counter() - encoded
        distortion = _distortion(points, decoded)
        if distortion.max_error > bound:
            reason = f"its error is {distortion.max_error:.3g} where {bound:.3g} is allowed"
        elif best is None or len(data) < best.size:
            seconds = prepared + encoded - started
            best = PeerResult(peer.name, len(data), search.length, distortion, seconds, decode_seconds, tries)
        if not peer.adjustable or not search.goes_on(distortion.max_error):
            break
    if best is None:
        raise UnreachableError(f"{peer.name}: {reason}")
    return best


class _LengthSearch:
    """Which length to try next: steps as if the error were proportional to it, then bisection of its logarithm."""

    def __init__(self, bound: float) -> None:
        self.length = bound
        self._bound = bound
        self._kept = 0.0
        self._refused = math.inf

    def goes_on(self, error: float) -> bool:
        """Take the error of the present length; False where no other is worth a try."""
        if error <= self._bound:
            self._kept = max(self._kept, self.length)
            if error == 0.0 or error >= CLOSE_ENOUGH * self._bound:
                return False
        else:
            self._refused = min(self._refused, self.length)
        if self._kept > 0.0 and self._refused < math.inf:
            self.length = math.sqrt(self._kept * self._refused)
            return self._kept < CLOSE_ENOUGH * self._refused
        # From above, a little farther than proportion says: a second miss would cost a whole try.
        towards = self._bound / error * (1.0 if self._kept else CLOSE_ENOUGH)
        self.length *= min(max(towards, 1.0 / FARTHEST_STEP), FARTHEST_STEP)
        return True


def _distortion(points: Float32Array, decoded: Float32Array) -> Distortion:
    if decoded.dtype != np.float32:
        raise TypeError(f"a peer gave {decoded.dtype}, not float32")
    meter = DistortionMeter()
    meter.add(points, decoded)
    return meter.result()
