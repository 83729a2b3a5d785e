"""Sheets of chains, distance and isometric bending constraints.

A cloth hangs by two corners, or drops on a sphere; a flag, pinned along its pole, waves in a gusty wind.
"""

from __future__ import annotations

import numpy as np

from pdecodec.mesh.arrays import Float64Array
from pdecodec.simulate.bending import IsometricBendingConstraints
from pdecodec.simulate.constraints import Constraints
from pdecodec.simulate.distance import ChainConstraints, DistanceConstraints
from pdecodec.simulate.meshing import bending_stencils, grid_quads, triangulate
from pdecodec.simulate.scenes import ClothOptions, FlagOptions
from pdecodec.simulate.simulation import Scene
from pdecodec.simulate.surroundings import Ground, Sphere, Wind
from pdecodec.simulate.system import System

DENSITY = 0.2
"""Density of cotton [kg/m^2]."""

STRETCH_STIFFNESS = 5e3
SHEAR_STIFFNESS = 5e2
"""Force per width at a strain of one, along the threads and across them [N/m]. Links of a thread get it at any
spacing.
"""

BENDING_RIGIDITY = 5e-5
"""Bending rigidity of cotton [J]."""

DAMPING = 1e-3
"""Damping time of stretch and bending [s]."""

DRAG = 0.2
"""Rate at which air slows the cloth [1/s]."""

CLIP_WIDTH_FRACTION = 0.03
"""Fraction of the width that is held at each corner; a single vertex would be pulled out into a thread."""

FRICTION = 0.4
"""Coulomb's coefficient of cloth on the sphere and on the ground."""

TWO_THREAD_MIN_PARTICLES = 4096
"""Smallest sheet, in particles, that is simulated in two halves by two threads; smaller ones gain nothing."""

WIND_DIRECTION = np.array([0.97, 0.0, 0.24])
"""Slightly across the flag at rest, so that the flag leaves its plane at once."""


def build_cloth(options: ClothOptions) -> Scene:
    """Build a level sheet around the origin in x and z, held by clips at two corners, or free above a sphere."""
    columns, rows = options.columns, options.rows
    spacing = options.size / (columns - 1)
    height = spacing * (rows - 1)
    x, z = np.meshgrid(np.arange(columns) * spacing - options.size / 2, np.arange(rows) * spacing - height / 2)
    positions = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)
    inverse_masses = np.full(x.size, 1 / (DENSITY * spacing**2))
    quads = grid_quads(columns, rows)[:, ::-1]  # outwards is up
    colliders: tuple[Ground | Sphere, ...] = ()
    if options.drape == "corners":
        clip = 1 + int(CLIP_WIDTH_FRACTION * columns)
        held = np.zeros((rows, columns), dtype=bool)
        held[:clip, :clip] = held[:clip, -clip:] = True
        inverse_masses[held.ravel()] = 0
    else:
        radius = 0.3 * min(options.size, height)
        thickness = 0.02 * radius
        center = (0.0, -radius - 2 * thickness, 0.0)
        sphere = Sphere(center=center, radius=radius, friction=FRICTION, thickness=thickness)
        colliders = (sphere, Ground(height=-2.5 * radius, friction=FRICTION, thickness=thickness))
    system = System(
        positions=positions,
        inverse_masses=inverse_masses,
        constraints=_sheet_constraints(positions, columns, rows),
        colliders=colliders,
        drag=DRAG,
        middle=_middle(columns, rows),
    )
    return Scene(
        name="cloth",
        system=system,
        visible=np.arange(x.size, dtype=np.int32),
        faces=quads if options.faces == "quads" else triangulate(quads),
    )


def build_flag(options: FlagOptions) -> Scene:
    """Build the flag: stretched in the xy plane, with its pole along y at x = 0."""
    columns, rows = options.columns, options.rows
    spacing = options.size / (columns - 1)
    x, y = np.meshgrid(np.arange(columns) * spacing, np.arange(rows) * spacing)
    positions = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    inverse_masses = np.full(x.size, 1 / (DENSITY * spacing**2))
    inverse_masses[::columns] = 0
    quads = grid_quads(columns, rows)
    triangles = triangulate(quads)
    direction = WIND_DIRECTION / np.linalg.norm(WIND_DIRECTION)
    system = System(
        positions=positions,
        inverse_masses=inverse_masses,
        constraints=_sheet_constraints(positions, columns, rows),
        winds=(Wind(triangles=triangles, velocity=options.wind * direction, gusts=options.gusts),),
        middle=_middle(columns, rows),
    )
    return Scene(
        name="flag",
        system=system,
        visible=np.arange(x.size, dtype=np.int32),
        faces=quads if options.faces == "quads" else triangles,
    )


def _middle(columns: int, rows: int) -> int:
    """Return the first particle of a large sheet's second half; for a small sheet, the number of particles."""
    return columns * (rows // 2 if columns * rows >= TWO_THREAD_MIN_PARTICLES else rows)


def _sheet_constraints(positions: Float64Array, columns: int, rows: int) -> tuple[Constraints, ...]:
    """Return warp and weft as chains, both diagonals of each quad, and isometric bending, of a flat grid.

    Chains are solved as wholes, so that a fine cloth stretches no more than a coarse one at the same substeps.
    """
    grid = np.arange(columns * rows, dtype=np.int32).reshape(rows, columns)
    down = np.stack([grid[:-1, :-1], grid[1:, 1:]], axis=-1).reshape(-1, 2)
    up = np.stack([grid[:-1, 1:], grid[1:, :-1]], axis=-1).reshape(-1, 2)
    diagonals = np.concatenate([down, up])
    stencils = bending_stencils(triangulate(grid_quads(columns, rows)))
    return (
        IsometricBendingConstraints.from_positions(
            positions, stencils, rigidity=BENDING_RIGIDITY, damping=DAMPING, stiffness=0.05
        ),
        DistanceConstraints.from_positions(
            positions, diagonals, compliance=1 / SHEAR_STIFFNESS, damping=DAMPING, stiffness=0.2
        ),
        ChainConstraints.from_positions(positions, grid, compliance=1 / STRETCH_STIFFNESS, damping=DAMPING),
        ChainConstraints.from_positions(positions, grid.T, compliance=1 / STRETCH_STIFFNESS, damping=DAMPING),
    )
