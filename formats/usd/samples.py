"""Which samples are written: one of a shape that is static, and at least one of some shape at each frame."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol

import numpy as np

from pdecodec.mesh.arrays import Float32Array


class StaticStart:
    """Leaves out the samples of a shape as long as its positions are those of the first frame.

    Attributes
    ----------
    codes : list of float
        Time codes of the samples that the last block needed.
    """

    def __init__(self) -> None:
        self.codes: list[float] = []
        self._still: Float32Array | None = None
        self._last = 0.0
        self._moves = False

    def needed(self, points: Float32Array, codes: Sequence[float], *, every: bool) -> tuple[Float32Array, list[float]]:
        """Return those positions (frames, vertices, 3) and time codes of a block that are written; all if `every`."""
        points, self.codes = self._needed(points, [*codes], every=every)
        return points, self.codes

    def held(self, codes: Sequence[float]) -> Float32Array:
        """Return the positions at time codes of the last block that needed no samples, (codes, vertices, 3)."""
        assert self._still is not None  # codes were left out
        return np.repeat(self._still[None], len(codes), axis=0)

    def _needed(self, points: Float32Array, codes: list[float], *, every: bool) -> tuple[Float32Array, list[float]]:
        if every or self._moves:
            self._moves = True
            return points, codes
        known, self._still = self._still, points[0].copy() if self._still is None else self._still
        # Most shapes that move have left their first position by the last frame.
        if np.array_equal(points[-1], self._still) and (points == self._still).all():
            self._last = codes[-1]
            return (points[:1], codes[:1]) if known is None else (points[:0], [])
        self._moves = True
        # The points were static until now, so the last static frame needs a sample, too.
        return (points, codes) if known is None else (np.concatenate([known[None], points]), [self._last, *codes])


class Shape(Protocol):
    """A shape whose samples are written."""

    vertices: int
    static: StaticStart

    def hold(self, codes: Sequence[float]) -> None:
        """Write samples that were left out."""


def hold_frames(shapes: Iterable[Shape], codes: Sequence[float]) -> None:
    """Write a sample of the smallest shape at time codes of the last block where no shape has one: they are frames."""
    every = [shape for shape in shapes if shape.vertices]
    missing = set(codes).difference(*(shape.static.codes for shape in every))
    if missing and every:
        min(every, key=lambda shape: shape.vertices).hold(sorted(missing))
