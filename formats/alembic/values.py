"""Select samples of Alembic's properties, and convert between arrays of its Python binding and NumPy's.

Loops over elements are avoided if possible. Arrays of floats, ints and their vectors share memory with NumPy.
Colours and unsigned integers have no buffer: colours are copied channel by channel; unsigned integers are written
through doubles and read one by one.

A sample refers to the arrays it was made from. The binding of a subdivision surface's samples does not keep them
alive, so the code that makes a sample keeps its arrays until the sample is written (`Keep`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import imath
import numpy as np
from alembic3d import Abc, AbcGeom
from numpy.typing import ArrayLike, NDArray

from pdecodec.formats.base.times import SAME_TIME
from pdecodec.mesh.arrays import Float32Array, Float64Array

SCOPES = {
    "vertex": AbcGeom.GeometryScope.kVertexScope,
    "face": AbcGeom.GeometryScope.kUniformScope,
    "corner": AbcGeom.GeometryScope.kFacevaryingScope,
    "object": AbcGeom.GeometryScope.kConstantScope,
}


WIDTHS = {"V2f": 2, "V3f": 3, "V3d": 3, "N3f": 3, "N3d": 3, "C3f": 3, "C4f": 4}
"""Columns of the types that have more than one."""


def select(time: float) -> Any:
    """Return a selector of the sample at a time [s]."""
    return Abc.ISampleSelector(float(time))


def sample_times(prop: Any) -> Float64Array:
    """Return the times [s] of the samples of a property or schema, at least one."""
    sampling = prop.getTimeSampling()
    return np.array([sampling.getSampleTime(index) for index in range(max(1, prop.getNumSamples()))], np.float64)


def samples_at(times: Float64Array, time: float) -> tuple[int, int, float]:
    """Return the samples before and after a time and the weight of the second; outside all samples, the nearest one."""
    index = int(np.searchsorted(times, time + SAME_TIME, side="right")) - 1
    if index < 0 or index == times.size - 1 or time - times[index] <= SAME_TIME:
        return max(index, 0), max(index, 0), 0.0
    return index, index + 1, float((time - times[index]) / (times[index + 1] - times[index]))


ALWAYS = (-np.inf, np.inf)
"""All times [s]."""


def times_within(times: Float64Array, span: tuple[float, float]) -> Float64Array:
    """Return the times [s] from the first of two edges up to the second without it."""
    return times[(times >= span[0] - SAME_TIME) & (times < span[1] - SAME_TIME)]


def change_times(props: Sequence[Any], span: tuple[float, float] = ALWAYS) -> Iterator[float]:
    """Yield the times [s] at which one of several array properties changes between its samples in a span of time."""
    for prop in props:
        if prop.getNumSamples() > 1 and not prop.isConstant():
            before = None
            for time in times_within(sample_times(prop), span).tolist():
                now = to_numpy(prop.getValue(select(time)))
                if before is not None and not np.array_equal(now, before):
                    yield time
                before = now


_CHANNELS = {
    **dict.fromkeys((imath.C3fArray, imath.C3cArray), "rgb"),
    **dict.fromkeys((imath.C4fArray, imath.C4cArray), "rgba"),
    **dict.fromkeys((imath.QuatfArray, imath.QuatdArray), "rxyz"),
}
"""Components of the elements of arrays that NumPy cannot read as a whole."""


def to_numpy(array: Any) -> NDArray[Any]:
    """Copy an imath array to NumPy, (n,) or (n, k)."""
    channels = _CHANNELS.get(type(array))
    if channels is not None:
        return np.stack([np.asarray(getattr(array, channel)) for channel in channels], axis=1)
    if isinstance(array, imath.UnsignedIntArray):
        return np.fromiter(array, np.int64, len(array))
    return np.array(array)


def float_array(values: ArrayLike) -> Any:
    """Convert (n,) to imath.FloatArray."""
    return imath.FloatArrayFromBuffer(np.ascontiguousarray(values, np.float32))


def int_array(values: ArrayLike) -> Any:
    """Convert (n,) to imath.IntArray."""
    return imath.IntArrayFromBuffer(np.ascontiguousarray(values, np.int32))


def double_array(values: ArrayLike) -> Any:
    """Convert (n,) to imath.DoubleArray."""
    return imath.DoubleArrayFromBuffer(np.ascontiguousarray(values, np.float64))


def byte_array(values: ArrayLike) -> Any:
    """Convert (n,) to imath.UnsignedCharArray."""
    bytes_ = np.ascontiguousarray(values, np.uint8)
    array = imath.UnsignedCharArray(bytes_.size)
    np.asarray(array)[:] = bytes_
    return array


def string_array(values: Sequence[str]) -> Any:
    """Convert texts to imath.StringArray."""
    array = imath.StringArray(len(values))
    for index, text in enumerate(values):
        array[index] = str(text)
    return array


def unsigned_array(values: ArrayLike) -> Any:
    """Convert (n,) to imath.UnsignedIntArray."""
    return imath.UnsignedIntArray(double_array(values))


def vector_array(values: ArrayLike) -> Any:
    """Convert (n, 2) or (n, 3) to imath.V2fArray or V3fArray."""
    rows = np.ascontiguousarray(values, np.float32)
    return imath.V3fArrayFromBuffer(rows) if rows.shape[1] == 3 else imath.V2fArrayFromBuffer(rows)


def double_vector_array(values: ArrayLike) -> Any:
    """Convert (n, 3) to imath.V3dArray."""
    return imath.V3dArrayFromBuffer(np.ascontiguousarray(values, np.float64))


def boolean_array(values: ArrayLike) -> Any:
    """Convert (n,) to imath.BoolArray."""
    mask = int_array(values)
    array = imath.BoolArray(False, len(mask))
    array[mask] = True
    return array


def color_array(values: ArrayLike) -> Any:
    """Convert (n, 3) or (n, 4) to imath.C3fArray or C4fArray."""
    rows = np.ascontiguousarray(values, np.float32)
    array = imath.C3fArray(len(rows)) if rows.shape[1] == 3 else imath.C4fArray(len(rows))
    for channel, column in zip("rgba", rows.T, strict=False):
        # A channel is a view of the array, so that writing to it fills the array.
        np.asarray(getattr(array, channel))[:] = column
    return array


def matrix_rows(matrix: Any) -> Float64Array:
    """Convert imath.M44d to (4, 4) float64."""
    return np.array([list(row) for row in matrix], np.float64)


def matrix_of(rows: Float64Array) -> Any:
    """Convert (4, 4) float64 to imath.M44d."""
    return imath.M44d(*rows.reshape(-1).tolist())


ARRAYS: dict[str, Callable[[Any], Any]] = {
    "Float": float_array,
    "Double": double_array,
    "Int32": int_array,
    "Uchar": byte_array,
    "V2f": vector_array,
    "V3f": vector_array,
    "V3d": double_vector_array,
    "N3f": vector_array,
    "N3d": double_vector_array,
    "Boolean": boolean_array,
    "UInt32": unsigned_array,
    "C3f": color_array,
    "C4f": color_array,
    "String": string_array,
}


class Keep:
    """Keeps arrays and samples alive as long as itself: ``keep(array)`` returns the array."""

    def __init__(self) -> None:
        self._held: list[Any] = []

    def __call__(self, value: Any) -> Any:
        self._held.append(value)
        return value


def normal_sample(rows: Float32Array, indices: Any, keep: Keep) -> Any:
    """Return normals as an Alembic sample: by corner if `indices` (an imath array) are given, else by vertex."""
    array = keep(vector_array(rows))
    if indices is None:
        return keep(AbcGeom.ON3fGeomParamSample(array, SCOPES["vertex"]))
    return keep(AbcGeom.ON3fGeomParamSample(array, keep(indices), SCOPES["corner"]))
