"""A peer that rounds numbers of its own making: what it loses is known before anything is coded."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from pdecodec.peers.peer import Encoder, Peer, UnreachableError
from pdecodec.sequence import Connectivity, Float32Array, Float64Array

Levels = TypeVar("Levels")

MOST_BITS = 52
"""Of a level: more are finer than a float64 tells apart."""


class Transform(Peer, Generic[Levels]):
    """Analysis, rounding, coding and synthesis apart, so that a search for a length need not code at every step."""

    @abstractmethod
    def analyse(self, points: Float32Array, connectivity: Connectivity) -> Callable[[float], Levels]:
        """What rounds one sequence: ``round_to(length) -> levels``.

        Parameters
        ----------
        points : (frames, vertices, 3) float32 [scene units]
        connectivity : Connectivity

        Returns
        -------
        callable
            Raises :class:`UnreachableError` below the least length it can do.
        """

    @abstractmethod
    def write(self, levels: Levels, connectivity: Connectivity) -> bytes:
        """All that :meth:`read` needs to give the levels back as they were."""

    @abstractmethod
    def read(self, data: bytes, connectivity: Connectivity) -> Levels:
        """Undo :meth:`write`."""

    @abstractmethod
    def synthesise(self, levels: Levels, connectivity: Connectivity) -> Float32Array:
        """Positions that the levels stand for.

        Returns
        -------
        (frames, vertices, 3) float32 [scene units]
        """

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        round_to = self.analyse(points, connectivity)
        return lambda length: self.write(round_to(length), connectivity)

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        return self.synthesise(self.read(data, connectivity), connectivity)


def rounded(values: Float64Array, step: float) -> NDArray[np.int64]:
    """Levels of the nearest multiples of a step.

    Raises
    ------
    UnreachableError
        If one would have more than :data:`MOST_BITS` bits.
    """
    largest = float(np.abs(values).max(initial=0.0))
    if largest >= 2.0**MOST_BITS * step:
        raise UnreachableError(f"steps of {step:.3g} for numbers up to {largest:.3g} are more than {MOST_BITS} bits")
    return np.rint(values / step).astype(np.int64)
