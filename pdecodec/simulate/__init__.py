"""The bundled simulator: extended position-based dynamics (XPBD), and scenes to encode.

Algorithm 1 of Fang et al. 2024 (Mathematics 12, 3175) is the method of Macklin, Mueller and Chentanez, "XPBD:
Position-based simulation of compliant constrained dynamics", Motion in Games 2016, run with small steps (Macklin et
al., "Small steps in physics simulation", SCA 2019). Position-based dynamics (Mueller et al. 2007) is available for
comparison: ``method="pbd"``.

Units are SI: metres, kilograms, seconds, newtons. The y axis points up. An object does not collide with itself.
Everything runs in a fixed order, large sheets on two threads, so that the same scene gives the same bits.
"""

from pdecodec.simulate.scenes import SCENES, build
from pdecodec.simulate.simulation import Scene, Simulation
from pdecodec.simulate.solver import Solver
from pdecodec.simulate.system import System

__all__ = ["SCENES", "Scene", "Simulation", "Solver", "System", "build"]
