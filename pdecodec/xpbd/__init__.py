"""The bundled simulator: extended position-based dynamics (XPBD), and scenes to encode.

Algorithm 1 of Fang et al. 2024 (Mathematics 12, 3175), which is the method of Macklin, Mueller and Chentanez,
"XPBD: Position-based simulation of compliant constrained dynamics", Motion in Games 2016, run with small steps
(Macklin et al., "Small steps in physics simulation", SCA 2019). Position-based dynamics (Mueller et al. 2007) is kept
beside it for comparison: ``method="pbd"``.

Units are SI: metres, kilograms, seconds, newtons. The y axis points up. There is no collision of an object with
itself. Everything runs on one thread in a fixed order, so that the same scene gives the same bits.

Names below are imported when they are first used: the list of scenes comes without numba.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pdecodec.xpbd.scenes import SCENES as SCENES
    from pdecodec.xpbd.scenes import build as build
    from pdecodec.xpbd.simulation import Scene as Scene
    from pdecodec.xpbd.simulation import Simulation as Simulation
    from pdecodec.xpbd.solver import Solver as Solver
    from pdecodec.xpbd.system import System as System

_HOME = {
    "SCENES": "scenes",
    "Scene": "simulation",
    "Simulation": "simulation",
    "Solver": "solver",
    "System": "system",
    "build": "scenes",
}

__all__ = ["SCENES", "Scene", "Simulation", "Solver", "System", "build"]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(f"pdecodec.xpbd.{_HOME[name]}"), name)
    raise AttributeError(f"module 'pdecodec.xpbd' has no attribute {name!r}")
