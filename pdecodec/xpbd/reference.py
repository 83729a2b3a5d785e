"""One sweep over a batch of constraints in plain numpy, as the equations stand: what the compiled sweeps must equal."""

from __future__ import annotations

import numpy as np

from pdecodec.sequence import Float64Array
from pdecodec.xpbd.constraints import Constraints, Method


def solve_reference(
    constraints: Constraints,
    positions: Float64Array,
    previous: Float64Array,
    inverse_masses: Float64Array,
    multipliers: Float64Array,
    *,
    time: float,
    substep: float,
    method: Method,
) -> None:
    """As :meth:`Constraints.solve`, for any type, through :meth:`Constraints.evaluate`.

    XPBD solves the rows of one constraint together (Eq. 6). PBD (Mueller et al. 2007) knows scalar constraints only
    and takes row after row.
    """
    for index, members in enumerate(constraints.particles):
        weights = inverse_masses[members]
        if not weights.any():
            continue
        if method == "pbd":
            for row in range(constraints.rows):
                value, gradient = constraints.evaluate(index, positions, time=time, method=method)
                slope = (weights[:, None] * gradient[row] ** 2).sum()
                if slope > 0:
                    step = -constraints.stiffness * value[row] / slope
                    positions[members] += weights[:, None] * gradient[row] * step
            continue
        value, gradient = constraints.evaluate(index, positions, time=time, method=method)
        scaled = constraints.compliances_of(index, positions, inverse_masses, substep) / substep**2  # Eq. 5
        damping = constraints.damping / substep
        system = np.einsum("aki,k,bki->ab", gradient, weights, gradient)
        rate = np.einsum("aki,ki->a", gradient, positions[members] - previous[members])
        right = -value - scaled * multipliers[index] - damping * rate
        # Eq. 6, with the damping terms of Macklin et al. 2016, Eq. 26.
        change = np.linalg.solve((1 + damping) * system + np.diag(scaled), right)
        multipliers[index] += change
        positions[members] += weights[:, None] * np.einsum("aki,a->ki", gradient, change)  # Eq. 7
