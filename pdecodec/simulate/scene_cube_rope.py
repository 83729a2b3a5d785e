"""The cube-rope: a long twisted beam of square section, of which only the surface is simulated.

The mesh is a tube of ``sides x rings`` vertices, 24 x 832 as in section 5 of Fang et al. 2024. Vertices come curve
after curve: vertex ``curve * rings + ring``, so that ``points.reshape(frames, sides, rings, 3)`` are the paper's
``w_nk``. Ends are open.

These constraints keep it in shape, in the order in which they are solved:

* struts in each section, to the opposite point and a quarter round: the square;
* diagonals of the surface's quads: shear, torsion, and stretch around the beam;
* braces through the inside, to the opposite curve about one thickness further on: they keep sections perpendicular to
  the axis, in steps long enough for Gauss-Seidel to carry bending along the rope;
* lengthwise chains, each solved as a whole and last: the rope's stretch and, with opposite sides, its bending.
"""

from __future__ import annotations

import math

import numpy as np

from pdecodec.mesh.arrays import Float64Array, Int32Array
from pdecodec.mesh.times import DEFAULT_FPS
from pdecodec.simulate.constraints import Constraints
from pdecodec.simulate.distance import ChainConstraints, DistanceConstraints
from pdecodec.simulate.meshing import triangulate, tube_quads
from pdecodec.simulate.scenes import CubeRopeOptions
from pdecodec.simulate.simulation import Scene
from pdecodec.simulate.surroundings import Pins
from pdecodec.simulate.system import STANDARD_GRAVITY, System

DENSITY = 1000.0
"""Density of rubber, about [kg/m^3]."""

WEIGHT_STRETCH = 0.02
"""Relative stretch of the upper end of the hanging rope by its own weight: a soft rubber, at 20 m."""

SECTION_STIFFNESS = 40.0
SHEAR_STIFFNESS = 4.0
"""Stiffness of struts in a section and of surface diagonals, over that of a brace. It keeps sections square to
a few hundredths, and lets one sweep per substep converge.
"""

DAMPING = 1e-3
"""Damping time of the lengthwise links [s]: vibration between links fades within a frame, waves stay."""

DRAG = 0.05
"""Rate at which air slows the rope [1/s]."""

SWING_COUNT = 1.5
"""Number of swings of a held end to either side and back, in the time of free fall over the rope's length."""

END_TILTS = {"one": 1.2, "both": 0.7}
"""Angle by which a held end follows the falling rope [rad]: a clamp that stayed level would kink it."""

END_PULL_RATIOS = {"one": 3.0, "both": 2.0}
"""Largest pull on a held end, divided by the rope's weight; it is three for a rope that swings down from level."""

END_APPROACH_RATIO = 0.2
"""Fraction of the length by which two held ends approach each other, so that the rope between them can swing."""


def build(options: CubeRopeOptions) -> Scene:
    """Build the scene: the rope lies stretched out along x, and falls."""
    sides, rings = options.sides, options.rings
    curves = np.arange(sides * rings, dtype=np.int32).reshape(sides, rings)
    positions = _rest_shape(options)
    held = curves[:, :1].T if options.hold == "one" else curves[:, [0, -1]].T
    mass = DENSITY * options.thickness**2 * options.length / curves.size
    inverse_masses = np.full(curves.size, 1 / mass)
    inverse_masses[held] = 0
    quads = tube_quads(curves)
    system = System(
        positions=positions,
        inverse_masses=inverse_masses,
        constraints=_constraints(positions, curves, options),
        pins=tuple(_held_end(positions, section, options) for section in held),
        drag=DRAG,
    )
    return Scene(
        name="cube-rope",
        system=system,
        visible=curves.ravel(),
        faces=quads if options.faces == "quads" else triangulate(quads),
        substeps=_substeps(options),
        frames=60,
    )


def _constraints(positions: Float64Array, curves: Int32Array, options: CubeRopeOptions) -> tuple[Constraints, ...]:
    """Return the constraints in the order of the list above.

    Neighbours in each batch share no particle, so a processor can overlap them. Stiffness follows from the material:
    a curve carries its share of the section, ``k = E A / l`` for each link. A brace spans `reach` links, and `reach`
    braces cross each section.
    """
    sides, rings = curves.shape
    spacing = options.length / (rings - 1)
    young = DENSITY * STANDARD_GRAVITY * options.length / WEIGHT_STRETCH
    link = spacing * sides / (young * options.thickness**2)
    reach = min(max(1, round(options.thickness / spacing)), rings - 1)
    brace = link * reach**2

    def struts(turn: int, shift: int, compliance: float) -> DistanceConstraints:
        """Connect each point to the one `turn` curves around and `shift` rings further."""
        first, second = curves[:, : rings - shift], np.roll(curves, -turn, axis=0)[:, shift:]
        if shift == 0 and 2 * turn == sides:
            first, second = first[:turn], second[:turn]  # each opposite pair once
        pairs = np.stack([first.ravel(), second.ravel()], axis=1)
        return DistanceConstraints.from_positions(positions, pairs, compliance=compliance)

    return (
        struts(sides // 2, 0, brace / SECTION_STIFFNESS),
        struts(sides // 4, 0, brace / SECTION_STIFFNESS),
        struts(1, 1, brace / SHEAR_STIFFNESS),
        struts(-1, 1, brace / SHEAR_STIFFNESS),
        struts(sides // 2, reach, brace),
        ChainConstraints.from_positions(positions, curves, compliance=link, damping=DAMPING),
    )


def _substeps(options: CubeRopeOptions) -> int:
    """Return the number of substeps at 24 frames per second.

    XPBD leaves the second derivative of constraints out of its matrix, so the sideways motion of a taut chain is
    integrated explicitly. With links of mass ``m`` and length ``l`` under the tension ``T``, this needs substeps
    shorter than ``sqrt(m l / T)``.
    """
    spacing = options.length / (options.rings - 1)
    shortest = math.sqrt(0.5 * spacing / (END_PULL_RATIOS[options.hold] * STANDARD_GRAVITY * options.rings))
    return max(20, math.ceil(1 / (DEFAULT_FPS * shortest)))


def _held_end(positions: Float64Array, ring: Int32Array, options: CubeRopeOptions) -> Pins:
    """Return a held section that is shaken across the rope, twisted, and turned down as the rope falls."""
    center = positions[ring].mean(axis=0)
    offsets = positions[ring] - center
    inwards = 1.0 if center[0] < options.length / 2 else -1.0
    fall = math.sqrt(options.length / STANDARD_GRAVITY)

    def path(time: float) -> Float64Array:
        share = min(time / fall, 1.0)
        ease = share * share * (3 - 2 * share)
        swing = math.sin(2 * math.pi * SWING_COUNT * time / fall)
        tilt = -inwards * END_TILTS[options.hold] * ease
        move = np.array(
            [0.5 * END_APPROACH_RATIO * options.length * inwards * ease if options.hold == "both" else 0.0, 0.0, 0.0]
        )
        move[2] = options.shake * swing
        turn = _rotation(2, tilt) @ _rotation(0, 0.5 * math.pi * swing)
        carried: Float64Array = center + move + offsets @ turn.T
        return carried

    return Pins(particles=ring, path=path)


def _rotation(axis: int, angle: float) -> Float64Array:
    """Return the rotation about a coordinate axis, (3, 3)."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[[first, second], [first, second]] = math.cos(angle)
    rotation[second, first], rotation[first, second] = math.sin(angle), -math.sin(angle)
    return rotation


def _rest_shape(options: CubeRopeOptions) -> Float64Array:
    """Sections of a straight twisted beam along x, curve after curve: (sides * rings, 3) [m]."""
    around = np.arange(options.sides) * 4 / options.sides
    edge, along = np.divmod(around, 1)
    corners = 0.5 * options.thickness * np.array([[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    start, end = corners[edge.astype(int)], corners[edge.astype(int) + 1]
    square = start + along[:, None] * (end - start)
    share = np.linspace(0, 1, options.rings)
    angle = 2 * math.pi * options.turns * share
    y, z = square[:, :1], square[:, 1:]
    positions = np.empty((options.sides, options.rings, 3))
    positions[..., 0] = options.length * share
    positions[..., 1] = np.cos(angle) * y - np.sin(angle) * z
    positions[..., 2] = np.sin(angle) * y + np.cos(angle) * z
    return positions.reshape(-1, 3)
