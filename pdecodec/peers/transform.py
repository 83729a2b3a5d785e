"""A peer that rounds numbers of its own making: what it loses is known before anything is coded."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import Generic, TypeVar

from pdecodec.peers.peer import Encoder, Peer
from pdecodec.sequence import Connectivity, Float32Array

Levels = TypeVar("Levels")


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
