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
