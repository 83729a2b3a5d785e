"""The solver's quantities as fields of a simulated sequence: velocities, elastic energies, Lagrange multipliers.

Fields have values on particles, but energies and multipliers belong to constraints. The particles of a constraint
get equal shares of them, so that the sum over all particles is the sum over all constraints.
"""

from __future__ import annotations

import numpy as np

from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.fields import Field
from pdecodec.simulate.constraints import Method
from pdecodec.simulate.solver import Solver
from pdecodec.simulate.system import System


def solver_fields(system: System, method: Method) -> tuple[Field, ...]:
    """Return the fields of a system, all of domain "vertex" and type float32.

    ``velocity`` [m/s], and for each kind of constraints (:attr:`Constraints.resists`) ``KIND_energy`` [J], unless all
    are rigid, and ``KIND_multiplier``, unless the method is "pbd", which has no multipliers.
    """
    fields = {"velocity": Field("velocity", "vertex", components=3, unit="m/s")}
    for batch in system.constraints:
        energy, multiplier = f"{batch.resists}_energy", f"{batch.resists}_multiplier"
        if batch.compliances.any():
            fields[energy] = Field(energy, "vertex", unit="J")
        if method == "xpbd":
            columns = batch.rows_of_each or 1
            fields[multiplier] = Field(multiplier, "vertex", components=columns, unit=batch.multiplier_unit)
    return tuple(fields.values())


def solver_values(solver: Solver) -> Float32Array:
    """Return the values of :func:`solver_fields`, field after field, at the solver's current state.

    Returns
    -------
    (particles, components of all fields) float32
        Velocities are those in the middle of the last substep, multipliers those at its end. Before the first substep
        multipliers are 0.
    """
    sums = {"velocity": solver.velocities}
    count = len(solver.positions)
    for batch, multipliers in zip(solver.system.constraints, solver.multipliers, strict=True):
        energies = batch.gather(batch.energies(solver.positions), count).sum(axis=1, keepdims=True)
        found = {f"{batch.resists}_energy": energies, f"{batch.resists}_multiplier": batch.gather(multipliers, count)}
        for name, values in found.items():
            sums[name] = sums[name] + values if name in sums else values
    columns = [sums[field.name] for field in solver_fields(solver.system, solver.method)]
    return np.concatenate(columns, axis=1).astype(np.float32)
