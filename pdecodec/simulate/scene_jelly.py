"""A cube of jelly that is thrown, spinning, on the ground: tetrahedra inside, the surface shown."""

from __future__ import annotations

import math

import numpy as np

from pdecodec.mesh.arrays import Float64Array, Int32Array
from pdecodec.simulate.constraints import Constraints
from pdecodec.simulate.distance import DistanceConstraints
from pdecodec.simulate.meshing import lattice_surface, lattice_tetrahedra, tetrahedron_edges, triangulate
from pdecodec.simulate.scenes import JellyOptions
from pdecodec.simulate.simulation import Scene
from pdecodec.simulate.surroundings import Ground
from pdecodec.simulate.system import System
from pdecodec.simulate.tetrahedra import NeoHookeanConstraints, VolumeConstraints, tetrahedron_volumes

DENSITY = 1000.0
"""Density of water, about [kg/m^3]."""

DAMPING = 2e-3
"""Damping time of the elastic forces [s]."""

FRICTION = 0.5
"""Coulomb's coefficient of jelly on the ground."""


def build(options: JellyOptions) -> Scene:
    """Build the cube: it stands on a corner, its own size above the ground at ``y = 0``."""
    axis = np.linspace(-0.5, 0.5, options.cells + 1) * options.size
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    offsets = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1) @ _tilt().T
    height = options.size - offsets[:, 1].min()
    positions = offsets + np.array([0.0, height, 0.0])
    spin = options.spin / math.sqrt(2) * np.array([1.0, 0.0, 1.0])
    tetrahedra = lattice_tetrahedra(options.cells)
    quads = lattice_surface(options.cells)
    visible, vertex_of = np.unique(quads, return_inverse=True)
    faces = vertex_of.reshape(quads.shape).astype(np.int32)
    system = System(
        positions=positions,
        inverse_masses=1 / _masses(positions, tetrahedra),
        velocities=np.cross(spin, offsets),
        constraints=_constraints(positions, tetrahedra, options),
        colliders=(Ground(friction=FRICTION),),
    )
    return Scene(
        name="jelly",
        system=system,
        visible=visible.astype(np.int32),
        faces=faces if options.faces == "quads" else triangulate(faces),
    )


def _tilt() -> Float64Array:
    """Return the rotation that turns a corner of the cube down, (3, 3)."""
    down = -np.ones(3) / math.sqrt(3)
    first = np.array([1.0, -1.0, 0.0]) / math.sqrt(2)
    return np.stack([first, -down, np.cross(first, -down)])


def _masses(positions: Float64Array, tetrahedra: Int32Array) -> Float64Array:
    """Give each corner a quarter of its tetrahedra's masses, (particles,) [kg]."""
    share = np.repeat(DENSITY * tetrahedron_volumes(positions, tetrahedra) / 4, 4)
    return np.bincount(tetrahedra.ravel(), share, len(positions)).astype(np.float64)


def _constraints(positions: Float64Array, tetrahedra: Int32Array, options: JellyOptions) -> tuple[Constraints, ...]:
    material = {"damping": DAMPING, "stiffness": 0.1}
    if options.material == "neo-hookean":
        elastic = {"young": options.young, "poisson": options.poisson}
        return (NeoHookeanConstraints.from_positions(positions, tetrahedra, **elastic, **material),)
    # A lattice of springs of stiffness E times the spacing stretches about as a solid of modulus E does.
    spring = options.young * options.size / options.cells
    edges = tetrahedron_edges(tetrahedra)
    springs = DistanceConstraints.from_positions(positions, edges, compliance=1 / spring, **material)
    return (springs, VolumeConstraints.from_positions(positions, tetrahedra))
