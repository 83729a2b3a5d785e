"""A flag, pinned along its pole, in a gusty wind."""

from __future__ import annotations

import numpy as np

from pdecodec.xpbd.meshing import grid_quads, triangulate
from pdecodec.xpbd.options import FlagOptions
from pdecodec.xpbd.scene_cloth import DENSITY, sheet_constraints
from pdecodec.xpbd.simulation import Scene
from pdecodec.xpbd.system import System
from pdecodec.xpbd.wind import Wind

WIND_DIRECTION = np.array([0.97, 0.0, 0.24])
"""Not quite along the flag at rest, so that it is blown out of its plane at once."""


def build(options: FlagOptions) -> Scene:
    """The flag hangs stretched in the xy plane, its pole along y at x = 0."""
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
        constraints=sheet_constraints(positions, columns, rows),
        winds=(Wind(triangles=triangles, velocity=options.wind * direction, gusts=options.gusts),),
    )
    return Scene(
        name="flag",
        system=system,
        visible=np.arange(x.size, dtype=np.int32),
        faces=quads if options.faces == "quads" else triangles,
        substeps=20,
        frames=100,
    )
