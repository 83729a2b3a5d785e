"""The scene: a cube-rope of the paper's size, simulated with the bundled XPBD.

The paper does not state the length of a frame, the rope's stiffness, or how the rope is held. Ours is held at both
ends, shaken, and falls from rest. A frame is an eighth of a second: within ten frames the rope falls into its curve,
as in the paper's Figure 2. For other twists, rates and moments see :mod:`pdecodec.research.reproduction.sweep`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.sequence import ArraySequence
from pdecodec.simulate import build

FRAMES = 11
"""Number of frames, 0 to 10."""

KEYFRAMES = slice(0, None, 2)
"""Keyframes 0, 2, 4, 6, 8, 10."""

FINE_STEPS = 3
"""Simulated frames per frame of the clip."""


@dataclass(frozen=True, kw_only=True)
class RopeSettings:
    """Size and frame rate of the rope.

    Points per curve and curves, by default the paper's 832 and 24; frames per second. Raises SettingsError if curves
    are too short for 50 control points.
    """

    rings: int = 832
    sides: int = 24
    fps: float = 8.0

    def __post_init__(self) -> None:
        if self.rings < 64:
            raise SettingsError(f"curves need 64 points or more for 50 control points, not {self.rings}")


@dataclass(frozen=True, eq=False)
class Rope:
    """Simulated frames 0 to 30, :data:`FINE_STEPS` per frame of the clip, and the CPU time of the simulation [s]."""

    settings: RopeSettings
    fine: ArraySequence
    seconds: float

    @cached_property
    def clip(self) -> ArraySequence:
        """Frames 0 to 10 as a mesh sequence."""
        return ArraySequence(
            self.fine.points[::FINE_STEPS],
            objects=self.fine.objects,
            times=self.fine.times[::FINE_STEPS],
            fps=self.settings.fps,
        )

    @cached_property
    def curves(self) -> Float64Array:
        """``w_nk`` of every curve at frames 0 to 10, (curves, frames, points, 3) float64 [m]."""
        return as_curves(self.fine.points[::FINE_STEPS], self.settings)

    @cached_property
    def diameter(self) -> float:
        """D of Eqs. 26 and 27: the largest distance between points of the first curve at frame 0 [m]."""
        return diameter_of(self.curves[0, 0])


def diameter_of(points: Float64Array) -> float:
    """Return the largest distance between points, (points, 3) [m]: D of Eqs. 26 and 27."""
    from scipy.spatial.distance import pdist

    return float(pdist(points).max())


def as_curves(points: Float32Array, settings: RopeSettings) -> Float64Array:
    """Return positions of the rope's vertices, curve by curve: (curves, frames, points, 3) float64 [m]."""
    shaped = points.astype(np.float64).reshape(len(points), settings.sides, settings.rings, 3)
    return np.ascontiguousarray(shaped.transpose(1, 0, 2, 3))


def as_points(curves: Float64Array) -> Float32Array:
    """Undo :func:`as_curves`; return (frames, vertices, 3) [m]."""
    frames = curves.shape[1]
    return np.ascontiguousarray(curves.transpose(1, 0, 2, 3)).reshape(frames, -1, 3).astype(np.float32)


def simulate_rope(settings: RopeSettings) -> Rope:
    """Simulate the rope."""
    started = time.process_time()
    fine = simulate(settings, frames=FINE_STEPS * (FRAMES - 1) + 1, fps=settings.fps * FINE_STEPS)
    return Rope(settings, fine, time.process_time() - started)


def simulate(
    settings: RopeSettings,
    *,
    frames: int,
    fps: float | None = None,
    substeps: int | None = None,
    turns: float | None = None,
) -> ArraySequence:
    """Simulate the rope at any frame rate; `substeps` per frame and `turns` of its section default to the
    scene's own.
    """
    twist = {} if turns is None else {"turns": turns}
    scene = build("cube-rope", rings=settings.rings, sides=settings.sides, **twist)
    return scene.simulate(frames=frames, fps=fps or settings.fps, substeps=substeps).to_array()


def own_substeps(settings: RopeSettings) -> int:
    """Return the number of substeps that the scene needs per frame of the clip."""
    scene = build("cube-rope", rings=settings.rings, sides=settings.sides)
    return FINE_STEPS * int(np.ceil(scene.substeps * 24.0 / (settings.fps * FINE_STEPS)))
