"""Types of the native core (core/bindings)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Part = tuple[int, Int32Array, Int32Array, Int32Array, Int32Array]
State = tuple[Float64Array, Float64Array, Float64Array]
Scaling = tuple[float, float, float]

class CorruptError(Exception): ...
class LimitError(Exception): ...

def encode_connectivity(parts: Sequence[Part], keep_order: bool) -> tuple[bytes, bytes]: ...
def coded_orders(parts: Sequence[Part]) -> list[tuple[Int32Array, Int32Array, Int32Array] | None]: ...
def decode_connectivity(
    conn: bytes, ordr: bytes, vertices: Sequence[int], most_corners: int
) -> list[tuple[Int32Array, Int32Array, Int32Array, Int32Array]]: ...
def encode_reference(starts: Int64Array, vertex: Int32Array, faces: int, grid: Int64Array) -> tuple[int, bytes]: ...
def decode_reference(
    starts: Int64Array, vertex: Int32Array, faces: int, vertices: int, predictor: int, data: bytes
) -> Int64Array: ...
def predict(
    positions: Float64Array,
    previous: Float64Array,
    inverse_masses: Float64Array,
    velocities: Float64Array,
    accelerations: Float64Array,
    substep: float,
    keep: float,
) -> None: ...
def solve_distances(
    state: State, pairs: Int32Array, lengths: Float64Array, multipliers: Float64Array, scaling: Scaling
) -> None: ...
def solve_chains(
    state: State, chains: Int32Array, lengths: Float64Array, multipliers: Float64Array, scaling: Scaling
) -> None: ...
def solve_bending(
    state: State, stencils: Int32Array, coefficients: Float64Array, multipliers: Float64Array, scaling: Scaling
) -> None: ...
def solve_attachments(
    state: State, attached: Int32Array, targets: Float64Array, multipliers: Float64Array, scaling: Scaling
) -> None: ...
def solve_volumes(
    state: State, tetrahedra: Int32Array, volumes: Float64Array, multipliers: Float64Array, scaling: Scaling
) -> None: ...
def solve_tetrahedra(
    state: State,
    tetrahedra: Int32Array,
    inverse_rest: Float64Array,
    volumes: Float64Array,
    multipliers: Float64Array,
    shear: float,
    bulk: float,
    damping: float,
    substep: float,
) -> None: ...
def project_tetrahedra(state: State, tetrahedra: Int32Array, inverse_rest: Float64Array, stiffness: float) -> None: ...
def add_wind(
    positions: Float64Array, past: Float64Array, triangles: Int32Array, pressure: float, forces: Float64Array
) -> None: ...
