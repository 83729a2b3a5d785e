"""Baselines that call the package a pipeline would use: meshoptimizer, Draco, zfp, SZ3, SPERR and pcodec (extra
`baselines`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import zstandard
from numpy.typing import NDArray

from pdecodec.codec.sections.bytestream import FieldReader, FieldWriter
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.sequence import Connectivity
from pdecodec.report.clips.baseline import Baseline, Encoder, UnreachableError
from pdecodec.research.baselines.quantised import Grid, GridDifferences, level_for
from pdecodec.research.baselines.traversal import fans

VERTEX_BYTES = 8
"""Bytes per vertex: three 16-bit grid coordinates and padding, since the codec takes multiples of four bytes."""

MESHOPT_LEVEL = 3
"""Level of meshoptimizer's vertex codec; this one compresses most."""

MAX_GRID_BITS = 24
"""Largest number of bits per coordinate. Draco allows 30 but computes in float32; more bits only take longer."""

DRACO_LEVEL = 10
"""Draco's strongest level. Its default, 7, is three times as fast and takes 3 to 13 % more bytes."""

INDEX_BITS = 12
"""Bits per coordinate that encode the index of a vertex: three coordinates index 2**36 vertices."""

ORDERS = ("FV", "VF")
"""Orders in which an axis is stored: frames by vertices, or vertices by frames. Which is smaller depends on the
clip. One block of all three axes took about twice as many bytes on the two clips tried.
"""


SPERR_MIN_SIDE = 2
"""Smallest number of frames and of vertices that SPERR accepts; shorter clips are padded with their last frame
or vertex.
"""

PCODEC_LEVEL = 12
"""Pcodec's strongest level."""


class Meshopt(Baseline):
    """16-bit grid coordinates, differences from frame to frame, the vertex codec, and zstandard over all of it."""

    name = "meshopt vertex codec + zstd"
    source = "Kapoulkine 2017 to 2025, meshoptimizer"
    package = "imagecodecs"

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        from imagecodecs import meshopt_encode

        def encode(length: float) -> bytes:
            grid = Grid.within(points, length)
            differences = np.diff(grid.coordinates(points), axis=0, prepend=0)
            if np.abs(differences).max() > np.iinfo(np.int16).max:
                raise UnreachableError(f"steps of {grid.step:.3g} need more than 16 bits")
            padded = np.zeros((*points.shape[:2], VERTEX_BYTES // 2), np.int16)
            padded[..., :3] = differences
            writer = FieldWriter()
            grid.write(writer)
            writer.numbers("Q", points.shape[0])
            for frame in padded:
                writer.sized(bytes(meshopt_encode(frame.view(np.uint8), level=MESHOPT_LEVEL)))
            frames = writer.to_bytes()
            return zstandard.ZstdCompressor(level=level_for(len(frames))).compress(frames)

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        from imagecodecs import meshopt_decode

        reader = FieldReader(zstandard.ZstdDecompressor().decompress(data), self.name)
        grid = Grid.read(reader)
        shape = (connectivity.vertex_count, VERTEX_BYTES)
        frames = [
            meshopt_decode(reader.sized(), shape=shape, dtype=np.uint8).reshape(shape).view(np.int16)[:, :3]
            for _ in range(reader.integers("Q")[0])
        ]
        return grid.positions(np.cumsum(np.stack(frames).astype(np.int64), axis=0))


class Draco(Baseline):
    """Every frame as a mesh of its own, by edgebreaker: each contains the connectivity, whose bytes count here.

    Draco returns vertices in its own order, which depends on connectivity alone. The decoder finds this order by
    decoding a mesh in which the position of each vertex is its index. If Draco merges or leaves out vertices, in
    that mesh or in a frame, all frames are coded as points in their original order instead, without faces.
    """

    name = "Draco a frame"
    source = "Google, Draco 1.5; Rossignac 1999, Edgebreaker: connectivity compression for triangle meshes"
    package = "DracoPy"

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        triangles = None if _order_of(connectivity) is None else _triangles(connectivity)
        low = points.reshape(-1, 3).min(axis=0).astype(np.float64)
        extent = float((points.reshape(-1, 3).max(axis=0) - low).max())

        def encode(length: float) -> bytes:
            step = Grid.within(points, length).step
            bits = max(1, math.ceil(math.log2(extent / step + 1.0)))
            if bits > MAX_GRID_BITS:
                raise UnreachableError(f"steps of {step:.3g} over {extent:.3g} are more than {MAX_GRID_BITS} bits")
            frames = None if triangles is None else _encode_meshes(points, triangles, low, step, bits)
            writer = FieldWriter()
            writer.numbers("QB", points.shape[0], frames is None)
            kept = self._faces_in_order(connectivity)
            for frame in frames or [_encode(frame, kept, low, step, bits, in_order=True) for frame in points]:
                writer.sized(frame)
            return writer.to_bytes()

        return encode

    def _faces_in_order(self, connectivity: Connectivity) -> NDArray[np.uint32] | None:
        """Return the triangles for coding in the original order of vertices."""
        return None

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        reader = FieldReader(data, self.name)
        frames, as_points = reader.integers("QB")
        order = None if as_points else _order_of(connectivity)
        points = np.empty((frames, connectivity.vertex_count, 3), np.float32)
        for frame in points:
            frame[slice(None) if order is None else order] = _decode(reader.sized())
        return points


class DracoWithFaces(Draco):
    """Like :class:`Draco`, but the bytes always contain the faces; if Draco would merge vertices, in their
    original order.
    """

    def _faces_in_order(self, connectivity: Connectivity) -> NDArray[np.uint32] | None:
        return _triangles(connectivity) if connectivity.face_count else None


def _encode_meshes(
    points: Float32Array, triangles: NDArray[np.uint32], low: Float64Array, step: float, bits: int
) -> list[bytes] | None:
    """Encode every frame as a mesh; None if Draco merges or leaves out vertices, or finds no triangle with an area."""
    import DracoPy

    try:
        frames = [_encode(frame, triangles, low, step, bits) for frame in points]
    except DracoPy.EncodingFailedException:
        return None
    return frames if all(len(_decode(frame)) == points.shape[1] for frame in frames) else None


def _encode(
    frame: NDArray[Any],
    triangles: NDArray[np.uint32] | None,
    low: Float64Array,
    step: float,
    bits: int,
    *,
    in_order: bool = False,
) -> bytes:
    """Encode a mesh, or points alone, in Draco's order of vertices or in the original one."""
    import DracoPy

    data: bytes = DracoPy.encode(
        frame.astype(np.float64),
        triangles,
        quantization_bits=bits,
        quantization_range=step * (2**bits - 1),
        quantization_origin=low,
        compression_level=DRACO_LEVEL,
        preserve_order=in_order,
    )
    return data


def _decode(data: bytes) -> Float32Array:
    import DracoPy

    return np.asarray(DracoPy.decode(data).points, np.float32)


def _triangles(connectivity: Connectivity) -> NDArray[np.uint32]:
    return fans(connectivity).astype(np.uint32)


def _order_of(connectivity: Connectivity) -> Int64Array | None:
    """Return the vertex at each position of Draco's output; None if Draco does not return every vertex once."""
    if connectivity.face_count == 0:
        return None
    mask = 2**INDEX_BITS - 1
    numbers = np.arange(connectivity.vertex_count)
    named = np.stack([numbers >> shift & mask for shift in (0, INDEX_BITS, 2 * INDEX_BITS)], axis=1)
    frames = _encode_meshes(named[None].astype(np.float32), _triangles(connectivity), np.zeros(3), 1.0, INDEX_BITS)
    if frames is None:
        return None
    found = np.rint(_decode(frames[0])).astype(np.int64)
    order: Int64Array = (found << np.array([0, INDEX_BITS, 2 * INDEX_BITS])).sum(axis=1)
    return order if np.array_equal(np.sort(order), numbers) else None


def encode_fields(points: Float32Array, compress: Callable[[Float32Array], bytes]) -> bytes:
    """Compress each axis of (frames, vertices, axes) float32 separately, in whichever order takes fewer bytes."""
    candidates = []
    for number, order in enumerate(ORDERS):
        writer = FieldWriter()
        writer.numbers("2Q2B", *points.shape, number)
        for axis in range(points.shape[2]):
            field = points[:, :, axis]
            writer.sized(compress(np.ascontiguousarray(field if order == "FV" else field.T)))
        candidates.append(writer.to_bytes())
    return min(candidates, key=len)


def decode_fields(data: bytes, decompress: Callable[[bytes, tuple[int, int]], NDArray[Any]]) -> Float32Array:
    """Undo :func:`encode_fields`; `decompress` is given the bytes and the shape of a field."""
    reader = FieldReader(data, "fields")
    frames, vertices, axes, number = reader.integers("2Q2B")
    points = np.empty((frames, vertices, axes), np.float32)
    for axis in range(axes):
        if ORDERS[number] == "FV":
            points[:, :, axis] = decompress(reader.sized(), (frames, vertices))
        else:
            points[:, :, axis] = decompress(reader.sized(), (vertices, frames)).T
    return points


class Zfp(Baseline):
    """zfp with a fixed accuracy. It supports only powers of two, so it seldom meets a bound closely."""

    name = "zfp"
    source = "Lindstrom 2014, Fixed-rate compressed floating-point arrays; fixed-accuracy mode"
    package = "zfpy"
    codes_fields = True

    def effective_length(self, length: float) -> float:
        return math.ldexp(1.0, math.frexp(length)[1] - 1)

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        import zfpy

        return lambda length: encode_fields(points, lambda field: zfpy.compress_numpy(field, tolerance=length))

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        import zfpy

        return decode_fields(data, lambda part, shape: zfpy.decompress_numpy(part))


class Sz3(Baseline):
    """SZ3: interpolation and Lorenzo prediction, with an absolute bound on every coordinate."""

    name = "SZ3"
    source = (
        "Liang et al. 2023, SZ3: a modular framework for composing prediction-based error-bounded lossy compressors"
    )
    package = "pysz"
    codes_fields = True

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        from pysz import sz, szAlgorithm, szConfig, szErrorBoundMode

        ways = [(False, szAlgorithm.INTERP_LORENZO)]
        if points.shape[2] == 1:  # A field with one axis: the best order and predictor differ by a factor of three.
            ways = [(flat, way) for flat in (False, True) for way in (ways[0][1], szAlgorithm.LORENZO_REG)]

        def encode(length: float) -> bytes:
            def compress(field: Float32Array) -> bytes:
                packed = []
                for is_flat, algorithm in ways:
                    settings = szConfig()
                    settings.errorBoundMode = szErrorBoundMode.ABS
                    settings.absErrorBound = length
                    settings.cmprAlgo = algorithm
                    compressed, _ = sz.compress(field.ravel() if is_flat else field, settings)
                    packed.append(bytes([is_flat]) + bytes(compressed))
                return min(packed, key=len)

            return encode_fields(points, compress)

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        from pysz import sz

        def decompress(part: bytes, shape: tuple[int, int]) -> Float32Array:
            written = (math.prod(shape),) if part[0] else shape
            field: Float32Array = sz.decompress(np.frombuffer(part[1:], np.uint8), np.float32, written)[0]
            return field.reshape(shape)

        return decode_fields(data, decompress)


class Sperr(Baseline):
    """SPERR: wavelets over frames and vertices, set partitioning, and correction of outliers, with an absolute
    bound on coordinates.
    """

    name = "SPERR"
    source = "Li, Lindstrom and Clyne 2023, Lossy scientific data compression with SPERR; point-wise error mode"
    package = "imagecodecs"
    codes_fields = True

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        from imagecodecs import SPERR, sperr_encode

        def encode(length: float) -> bytes:
            def compress(field: Float32Array) -> bytes:
                missing = [(0, max(0, SPERR_MIN_SIDE - size)) for size in field.shape]
                return bytes(sperr_encode(np.pad(field, missing, mode="edge"), length, SPERR.MODE.PWE))

            return encode_fields(points, compress)

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        from imagecodecs import sperr_decode

        return decode_fields(data, lambda part, shape: np.asarray(sperr_decode(part))[: shape[0], : shape[1]])


class Pcodec(GridDifferences):
    """Grid coordinates, differences in time, and pcodec on each axis, in the order that takes fewer bytes."""

    name = "quantise + delta in time + pcodec"
    source = "Loncaric, Jeppesen and Zinberg 2025, Pcodec: better compression for numerical sequences"
    package = "pcodec"

    def write(self, writer: FieldWriter, differences: Int64Array) -> None:
        from pcodec import ChunkConfig, standalone

        settings = ChunkConfig(compression_level=PCODEC_LEVEL)
        for axis in range(differences.shape[2]) if len(differences) else ():
            field = differences[:, :, axis]
            ordered = (np.ascontiguousarray(field).ravel(), np.ascontiguousarray(field.T).ravel())
            packed = [bytes(standalone.simple_compress(numbers, settings)) for numbers in ordered]
            best = min(range(len(ORDERS)), key=lambda number: len(packed[number]))
            writer.numbers("B", best)
            writer.sized(packed[best])

    def read(self, reader: FieldReader, shape: tuple[int, int, int]) -> Int64Array:
        from pcodec import standalone

        differences = np.empty(shape, np.int64)
        for axis in range(differences.shape[2]) if len(differences) else ():
            (number,) = reader.integers("B")
            ordered = shape[:2] if ORDERS[number] == "FV" else shape[1::-1]
            field = np.asarray(standalone.simple_decompress(reader.sized())).reshape(ordered)
            differences[:, :, axis] = field if ORDERS[number] == "FV" else field.T
        return differences
