"""Baselines without a transform: numbers as they are, or on a grid as differences in time and over the mesh."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
import zstandard
from numpy.typing import DTypeLike, NDArray

from pdecodec.codec.sections.bytestream import FieldReader, FieldWriter
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.sequence import Connectivity
from pdecodec.report.clips.baseline import Baseline, Encoder, UnreachableError
from pdecodec.research.baselines.coding import decode_over_mesh, encode_over_mesh
from pdecodec.research.baselines.traversal import traverse

CUBE_BOUND_RATIO = 0.999
"""Fraction of the bound that the cube may take: the decoded float32 is rounded too."""

MAX_COORDINATE_BITS = 31
"""Largest number of bits of a grid coordinate; more would be finer than float32 over the range of the sequence."""

ZSTD_LEVEL = 19
"""The strongest zstandard level that does not take unusually much memory."""

LARGE_ZSTD_LEVEL = 17
"""Level for large inputs, which are compressed anew for every bound: 1 to 3 % more bytes in two thirds of the time."""

LARGE_MIN_BYTES = 2**22
"""Bytes from which an input counts as large."""

DIFFERENCES = (1, 2)
"""Orders of the differences in time; the second wins where motion is smooth and the bound tight."""


def grid_step(bound: float, axes: int = 3) -> float:
    """Return the step of a grid whose nearest points lie within a Euclidean bound: the side of a cube whose corners are
    at that distance from its centre.
    """
    return CUBE_BOUND_RATIO * 2.0 / math.sqrt(axes) * bound


@dataclass(frozen=True)
class Grid:
    """Grid coordinates of positions: ``low + coordinate * step`` in float64 [scene units], then float32."""

    low: Float64Array
    step: float

    @classmethod
    def within(cls, points: Float32Array, bound: float) -> Grid:
        """Make the coarsest grid, from the lowest corner of `points`, whose nearest points lie within `bound`.

        Raises
        ------
        UnreachableError
            If its coordinates would have more than :data:`MAX_COORDINATE_BITS` bits.
        """
        axes = points.shape[2]
        low = points.reshape(-1, axes).min(axis=0).astype(np.float64)
        step = grid_step(bound, axes)
        extent = float((points.reshape(-1, axes).max(axis=0) - low).max())
        if extent / step >= 2.0**MAX_COORDINATE_BITS:
            raise UnreachableError(f"steps of {step:.3g} over {extent:.3g} are more than {MAX_COORDINATE_BITS} bits")
        return cls(low, step)

    def coordinates(self, points: Float32Array) -> Int64Array:
        """Return the nearest grid points, (..., axes) int64."""
        return np.rint((points - self.low) / self.step).astype(np.int64)

    def positions(self, coordinates: Int64Array) -> Float32Array:
        """Return the positions of grid coordinates, (..., axes) float32 [scene units]."""
        return (coordinates * self.step + self.low).astype(np.float32)

    def write(self, writer: FieldWriter) -> None:
        writer.numbers(f"B{1 + self.low.size}d", self.low.size, self.step, *self.low)

    @classmethod
    def read(cls, reader: FieldReader) -> Grid:
        (axes,) = reader.integers("B")
        step, *low = reader.reals(f"{1 + axes}d")
        return cls(np.array(low), step)


def level_for(size: int) -> int:
    """Return the zstandard level for `size` bytes of differences."""
    return ZSTD_LEVEL if size < LARGE_MIN_BYTES else LARGE_ZSTD_LEVEL


def squeeze(values: NDArray[Any], *, level: int = ZSTD_LEVEL) -> bytes:
    """Compress an array with zstandard after grouping bytes of equal significance, as Blosc and HDF5 shuffle them."""
    contiguous = np.ascontiguousarray(values)
    bytes_by_weight = contiguous.reshape(-1).view(np.uint8).reshape(-1, contiguous.itemsize).T
    return zstandard.ZstdCompressor(level=level).compress(bytes_by_weight.tobytes())


def unsqueeze(data: bytes, number: DTypeLike, shape: tuple[int, ...]) -> NDArray[Any]:
    """Undo :func:`squeeze`."""
    kind = np.dtype(number)
    bytes_by_weight = np.frombuffer(zstandard.ZstdDecompressor().decompress(data), np.uint8).reshape(kind.itemsize, -1)
    return np.ascontiguousarray(bytes_by_weight.T).view(kind).reshape(shape)


def narrowest(values: Int64Array) -> NDArray[Any]:
    """Convert integers to the smallest type that holds them all."""
    largest = int(np.abs(values).max(initial=0))
    kinds = (np.int8, np.int16, np.int32, np.int64)
    return values.astype(next(kind for kind in kinds if largest <= np.iinfo(kind).max))


class _RawBaseline(Baseline):
    """Positions stored as the type `number`, whatever the bound."""

    adjustable = False
    number: type[np.float32] | type[np.float16]

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        def encode(length: float) -> bytes:
            largest = float(np.abs(points).max())
            if largest > float(np.finfo(self.number).max):
                raise UnreachableError(f"a coordinate of {largest:.3g} is too large for {self.number.__name__}")
            writer = FieldWriter()
            writer.numbers("2Q", *points.shape[:2])
            writer.sized(squeeze(points.astype(self.number)))
            return writer.to_bytes()

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        reader = FieldReader(data, self.name)
        frames, vertices = reader.integers("2Q")
        return unsqueeze(reader.sized(), self.number, (frames, vertices, 3)).astype(np.float32)


class RawFloat32(_RawBaseline):
    """Storage without a codec: float32 positions, bytes of equal significance grouped, zstandard."""

    name = "float32 + zstd"
    source = "Collet and Kucherawy 2021, RFC 8878"
    number = np.float32


class RawFloat16(_RawBaseline):
    """Float16 positions, grouped and compressed likewise, as game engines store vertex caches; the error is fixed."""

    name = "float16 + zstd"
    source = "IEEE 754 binary16; RFC 8878"
    number = np.float16


class GridDifferences(Baseline):
    """Grid coordinates and their differences in time; the first frame's differences run along the vertices.

    Subclasses code the differences.
    """

    codes_fields = True

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        def encode(length: float) -> bytes:
            grid = Grid.within(points, length)
            coordinates = grid.coordinates(points)
            writer = FieldWriter()
            grid.write(writer)
            writer.numbers("2Q", *points.shape[:2])
            self.write(writer, np.diff(coordinates[:1], axis=1, prepend=0))
            self.write(writer, np.diff(coordinates, axis=0))
            return writer.to_bytes()

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        reader = FieldReader(data, self.name)
        grid = Grid.read(reader)
        frames, vertices = reader.integers("2Q")
        first = np.cumsum(self.read(reader, (1, vertices, grid.low.size)), axis=1)
        later = self.read(reader, (frames - 1, vertices, grid.low.size))
        return grid.positions(np.cumsum(np.concatenate([first, later]), axis=0))

    @abstractmethod
    def write(self, writer: FieldWriter, differences: Int64Array) -> None:
        """Encode (frames, vertices, axes) differences; there may be no frames."""

    @abstractmethod
    def read(self, reader: FieldReader, shape: tuple[int, int, int]) -> Int64Array:
        """Decode differences of shape (frames, vertices, axes)."""


class QuantiseDelta(GridDifferences):
    """Grid coordinates, differences in time, zstandard: what studios typically write themselves.

    Fields, of one axis, are written by frame or by row, whichever takes fewer bytes: sparse ones differ by half.
    """

    name = "quantise + delta in time + zstd"
    source = "common practice; RFC 8878"

    def write(self, writer: FieldWriter, differences: Int64Array) -> None:
        narrow = narrowest(differences.transpose(0, 2, 1))  # one axis at a time, because values of one axis are similar
        orders = (narrow, narrow.transpose(2, 1, 0)) if narrow.shape[1] == 1 else (narrow,)
        packed = [squeeze(numbers, level=level_for(narrow.nbytes)) for numbers in orders]
        best = min(range(len(packed)), key=lambda number: len(packed[number]))
        writer.numbers("QB", narrow.itemsize, best)
        writer.sized(packed[best])

    def read(self, reader: FieldReader, shape: tuple[int, int, int]) -> Int64Array:
        frames, vertices, axes = shape
        itemsize, by_row = reader.integers("QB")
        shape_written = (vertices, axes, frames) if by_row else (frames, axes, vertices)
        differences = unsqueeze(reader.sized(), f"i{itemsize}", shape_written).astype(np.int64)
        return differences.transpose((2, 0, 1) if by_row else (0, 2, 1))


class Lorenzo(Baseline):
    """Dynapack's extended Lorenzo predictor, with the mean of several parallelograms, and the range coder."""

    name = "extended Lorenzo (Dynapack)"
    source = "Ibarria and Rossignac 2003, Dynapack: space-time compression of the 3D animations of triangle meshes"

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        traversal = traverse(connectivity)

        def encode(length: float) -> bytes:
            grid = Grid.within(points, length)
            differences = grid.coordinates(points)
            coded = []
            for _ in DIFFERENCES:
                differences = np.diff(differences, axis=0, prepend=0)
                columns = differences.transpose(1, 0, 2).reshape(points.shape[1], -1)
                coded.append(encode_over_mesh(columns, traversal))
            order, smallest = min(zip(DIFFERENCES, coded, strict=True), key=lambda each: len(each[1]))
            writer = FieldWriter()
            grid.write(writer)
            writer.numbers("QB", points.shape[0], order)
            writer.sized(smallest)
            return writer.to_bytes()

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        reader = FieldReader(data, self.name)
        grid = Grid.read(reader)
        frames, order = reader.integers("QB")
        columns = decode_over_mesh(reader.sized(), 3 * frames, traverse(connectivity))
        coordinates = columns.reshape(-1, frames, 3).transpose(1, 0, 2)
        for _ in range(order):
            coordinates = np.cumsum(coordinates, axis=0)
        return grid.positions(coordinates)
