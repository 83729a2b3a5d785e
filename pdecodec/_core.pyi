"""Types of the native core (core/bindings)."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
Float64Array = NDArray[np.float64]
FloatArray = NDArray[np.float32] | NDArray[np.float64]
Part = tuple[int, Int32Array, Int32Array, Int32Array, Int32Array]

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
def extract_curves(parts: Sequence[Part], reference: Int64Array) -> tuple[Int32Array, Int64Array]: ...

FRAMES_AT_ONCE: int

def evaluate_frames(time: FloatArray, fields: FloatArray, reference: Float64Array, out: FloatArray) -> None: ...
def add_displacement(weights: Float64Array, fields: FloatArray, moved: Float64Array) -> None: ...

class FrameSpline:
    """The C2 cubic spline through all frames of a clip, not-a-knot, as weights of frames.

    ``value(t[i]) = sum over j of weights[i, j] * X[firsts[i] + j]``.

    Parameters
    ----------
    times : (frames,) float64 [s]
        Of the frames: at least one; increasing by 2^-53 or more; within 2^53 of 0.

    Attributes
    ----------
    width : int
        Frames in a window.
    """

    def __init__(self, times: Float64Array) -> None: ...
    @property
    def width(self) -> int: ...
    def weights(self, times: Float64Array, derivative: Literal[0, 1, 2] = 0) -> tuple[Int64Array, Float64Array]:
        """``firsts``, (n,) int64: first frame of each window; ``weights``, (n, width) float64.

        Of the position at each time, of the velocity [1/s] or of the acceleration [1/s^2]. Times outside the clip are
        taken as its nearest end.
        """

class Patches:
    """Patches, or pieces of curves, and the partition tree that halves the mesh down to them.

    Attributes
    ----------
    order : (vertices,) int32
        Vertices of the mesh, patch after patch.
    starts : (patches + 1,) int64
        Patch p holds ``order[starts[p]:starts[p + 1]]``.
    begins : (nodes,) int64
        Where in `order` each node of the tree begins; node 0 is the whole.
    children : (nodes,) int64
        First of the two halves of each node, the second follows it; -1 for a patch.
    node_of : (patches,) int64
        The node that each patch is.
    """

    @property
    def order(self) -> Int32Array: ...
    @property
    def starts(self) -> Int64Array: ...
    @property
    def begins(self) -> Int64Array: ...
    @property
    def children(self) -> Int64Array: ...
    @property
    def node_of(self) -> Int64Array: ...

def early_patches(objects: Sequence[Part], points: int) -> Patches | None: ...
def build_patches(objects: Sequence[Part], grid: Int64Array, points: int, early: Patches | None) -> Patches: ...
def cut_curves(order: Int32Array, starts: Int64Array, points: int) -> Patches: ...

class SpaceBasis:
    def __init__(
        self,
        kind: int,
        points: int,
        functions: int,
        threshold: int,
        rate: float,
        affine: bool,
        patches: Patches,
        grid: Int64Array,
        masks: bytes | None,
        threads: int,
    ) -> None: ...
    @property
    def functions(self) -> int: ...
    @property
    def coefficient_starts(self) -> Int64Array: ...
    @property
    def nearest(self) -> float: ...
    def subbands(self) -> tuple[Int64Array, Int64Array, Int64Array]: ...
    def encode_masks(self) -> bytes: ...
    def make_functions(self, threads: int) -> None: ...
    def functions_of(self, element: int) -> Float64Array: ...
    def project(self, values: Float64Array, threads: int) -> Float64Array: ...

class Expansion:
    def __init__(self, basis: SpaceBasis, coefficients: Float64Array) -> None: ...
    def synthesise(self) -> None: ...
    def expand(self, first: int, end: int, fields: FloatArray) -> None: ...

POLYNOMIAL_EXPONENTS: list[tuple[int, int, int]]

def series_functions(points: Float64Array, rate: float, order: int) -> Float64Array: ...
def arc_length_parameters(grid: Int64Array, pieces: Patches) -> Float64Array: ...
def local_coordinates(grid: Int64Array) -> tuple[int, Int64Array]: ...
def integer_root(square: int) -> int: ...
