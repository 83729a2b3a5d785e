"""Build a glTF file: collect nodes, meshes and accessors, then lay them out as JSON and bytes."""

from __future__ import annotations

import base64
import copy
import importlib
import io
import math
import shutil
import tempfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.errors import MissingExtraError
from pdecodec.formats.gltf.compression import MESHOPT_NAMES
from pdecodec.formats.gltf.file import (
    CHUNK_HEADER,
    COMPONENTS,
    GLB_HEADER,
    GLB_MAGIC,
    WIDTHS,
    GltfFile,
    json_bytes,
)
from pdecodec.mesh.arrays import Float32Array

QUANTIZATION, MESHOPT = "KHR_mesh_quantization", "EXT_meshopt_compression"


MESHOPT_VERTEX_VERSION, MESHOPT_STRIDE = 0, 256
"""Version of meshoptimizer's vertex codec that the extension prescribes, and its longest rows [bytes]."""


MANTISSA_BITS, EXPONENT_RANGE = 23, (-100, 100)
"""Bits without the sign, and exponents, that meshoptimizer's exponential filter can hold."""


VERTEX_DATA, INDEX_DATA = 34962, 34963
"""glTF's codes for the content of a buffer view (``target``): vertex attributes, vertex indices."""


HELD_BYTES, COPIED_BYTES = 2**22, 3 * 2**18
"""Bytes of data that are held in memory before they go to a temporary file, and bytes that are copied at once."""

Coded = tuple[str, NDArray[Any]]
"""A filter of meshoptimizer, and rows in its form."""

_SMALLEST_DIVISOR = float(np.finfo(np.float64).tiny)

_ALIGNMENT = 4
"""Parts of a file begin at multiples of this [bytes]."""


class GltfBuilder:
    """Collects nodes, meshes and accessors of a glTF file.

    Parameters
    ----------
    meshopt : bool
        Whether meshoptimizer compresses the buffers, without loss; only viewers that support the extension can then
        show the file.
    folder : pathlib.Path, optional
        Where a temporary file holds the data until :meth:`save`. Default: the system's folder for such files.

    Raises
    ------
    MissingExtraError
        If meshoptimizer is not installed.
    """

    def __init__(self, *, meshopt: bool = False, folder: Path | None = None) -> None:
        self.root: dict[str, Any] = {"asset": {"version": "2.0", "generator": "pdecodec"}}
        self._data: IO[bytes] = io.BytesIO()
        self._folder = folder
        self._unpacked = 0
        self._others: list[dict[str, Any]] = []
        self._encoder: Any = None
        if meshopt:
            try:
                self._encoder = importlib.import_module("meshoptimizer")
            except ModuleNotFoundError as error:
                raise MissingExtraError(
                    "compression of glTF needs the package meshoptimizer; run: pip install 'pdecodec[gltf]'"
                ) from error
            self._encoder.encode_vertex_version(MESHOPT_VERTEX_VERSION)
            self.require(MESHOPT)

    @property
    def is_compressed(self) -> bool:
        """Whether meshoptimizer compresses the data."""
        return self._encoder is not None

    def begin_with(self, file: GltfFile) -> None:
        """Start with everything that an existing file holds, its buffers joined to one. Call this before adding
        anything.
        """
        mine = self.root.get("extensionsRequired", ())
        self.root = copy.deepcopy(dict(file.root))
        for extension in mine:
            self.require(extension)
        numbers: dict[int, tuple[int, int]] = {}
        for index, (entry, data) in enumerate(zip(self.root.get("buffers", []), file.buffers, strict=True)):
            if data:
                numbers[index] = 0, self._append(data)
            else:
                self._others.append(entry)
                numbers[index] = len(self._others), 0
        for view in self.root.get("bufferViews", []):
            packed = [view["extensions"][name] for name in MESHOPT_NAMES if name in view.get("extensions", {})]
            for entry in (view, *packed):
                number, offset = numbers[entry["buffer"]]
                entry |= {"buffer": number, "byteOffset": entry.get("byteOffset", 0) + offset}

    def require(self, extension: str) -> None:
        """Declare an extension without which the file cannot be shown."""
        self.use(extension, is_required=True)

    def use(self, extension: str, *, is_required: bool) -> None:
        """Declare an extension, and whether the file can only be shown by viewers that support it."""
        for kind in ("extensionsUsed", "extensionsRequired")[: 1 + is_required]:
            names = self.root.setdefault(kind, [])
            if extension not in names:
                names.append(extension)

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Append an entry to a list of the root and return its index."""
        entries = self.root.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def view(
        self,
        data: NDArray[Any],
        target: int | None = None,
        *,
        triangles: bool = False,
        coded: Coded | None = None,
    ) -> int:
        """Add a buffer view with one row per item of an array and return its index.

        If `triangles` is true, compression may rotate the order of each triangle's corners. `coded` names a
        filter of meshoptimizer, and what is compressed in its form in place of `data`.
        """
        entry: dict[str, Any] = {"buffer": 0, "byteLength": data.nbytes}
        stride = data.nbytes // max(1, len(data))
        if target is not None:
            entry["target"] = target
        if data.ndim == 2 and data.dtype.kind in "iu":
            # Rows are padded to multiples of four bytes, so the stride has to be declared.
            entry["byteStride"] = stride
        packed = self._packed(data if coded is None else coded[1], stride, triangles=triangles)
        if packed is None:
            entry["byteOffset"] = self._append(np.ascontiguousarray(data).data)
        else:
            mode, found = packed
            entry |= {"buffer": 1 + len(self._others), "byteOffset": self._unpacked}
            self._unpacked += data.nbytes + -data.nbytes % _ALIGNMENT
            place = {"buffer": 0, "byteOffset": self._append(found), "byteLength": len(found)}
            entry["extensions"] = {MESHOPT: {**place, "byteStride": stride, "count": len(data), "mode": mode}}
            if coded is not None:
                entry["extensions"][MESHOPT]["filter"] = coded[0]
        return self.add("bufferViews", entry)

    def _append(self, data: bytes | memoryview) -> int:
        self._data.write(bytes(-self._data.tell() % _ALIGNMENT))
        offset = self._data.tell()
        self._data.write(data)
        if isinstance(self._data, io.BytesIO) and self._data.tell() > HELD_BYTES:
            held, self._data = self._data, tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115 - closed by close()
            self._data.write(held.getbuffer())
        return offset

    def _packed(self, data: NDArray[Any], stride: int, *, triangles: bool) -> tuple[str, bytes] | None:
        """Return the mode and bytes of compressed rows; None if compression does not make them smaller."""
        if self._encoder is None or not data.size:
            return None
        found: bytes
        if data.ndim == 1 and data.dtype.kind == "u" and stride in (2, 4):
            encode = self._encoder.encode_index_buffer if triangles else self._encoder.encode_index_sequence
            mode, found = "TRIANGLES" if triangles else "INDICES", encode(data.astype(np.uint32))
        elif stride % 4 == 0 and stride <= MESHOPT_STRIDE:
            mode, found = "ATTRIBUTES", self._encoder.encode_vertex_buffer(data, len(data), stride)
        else:
            return None
        return (mode, found) if len(found) < data.nbytes else None

    def floats(
        self,
        values: ArrayLike,
        *,
        target: int | None = None,
        bounds: bool = False,
        coded: Coded | None = None,
    ) -> int:
        """Add an accessor of float32 rows, on request with their minimum and maximum, and return its index.

        `coded` is as for :meth:`view`.
        """
        rows = np.ascontiguousarray(values, "<f4")
        table = rows.reshape(len(rows), -1) if rows.size else rows.reshape(len(rows), 1)
        limits = {"min": table.min(axis=0).tolist(), "max": table.max(axis=0).tolist()} if bounds else {}
        kind = next(name for name, numbers in WIDTHS.items() if numbers == table.shape[1])
        return self._accessor("<f4", len(rows), kind, bufferView=self.view(rows, target, coded=coded), **limits)

    def rounded(self, values: ArrayLike, step: float, *, target: int | None = None, bounds: bool = False) -> int:
        """Add an accessor of float32 rows (n, k) like :meth:`floats`, rounded if that makes compression better.

        Values become multiples of the power of two at or below `step`, or of a larger one if they need too many digits.
        """
        rows = np.asarray(values, np.float32)
        if self._encoder is None or not rows.size or not np.isfinite(rows).all():
            return self.floats(rows, target=target, bounds=bounds)
        needed = math.frexp(float(np.abs(rows).max()))[1] - MANTISSA_BITS + 1
        exponent = min(max(math.frexp(step)[1] - 1, needed, EXPONENT_RANGE[0]), EXPONENT_RANGE[1])
        wholes = np.rint(np.ldexp(rows.astype(np.float64), -exponent)).astype(np.int32)
        coded = np.uint32((exponent & 0xFF) << 24) | (wholes & 0xFFFFFF).astype("<u4")
        found = np.ldexp(wholes.astype(np.float64), exponent)
        return self.floats(found, target=target, bounds=bounds, coded=("EXPONENTIAL", coded))

    def directions(self, normals: Float32Array) -> int:
        """Add an accessor of unit vectors (n, 3) of 8 bits; compressed, they are points of an octahedron."""
        if self._encoder is None:
            return self.fractions(normals, "<i1", target=VERTEX_DATA)
        rows = normals.astype(np.float64) / np.maximum(np.abs(normals).sum(axis=1, keepdims=True), _SMALLEST_DIVISOR)
        x, y, z = rows.T
        folded = [np.where(z < 0, np.where(a < 0, -1, 1) * (1 - np.abs(b)), a) for a, b in ((x, y), (y, x))]
        coded = np.zeros((len(rows), 4), np.int8)
        coded[:, :2], coded[:, 2] = np.rint(np.stack(folded, axis=1) * 127), 127
        return self.fractions(normals, "<i1", target=VERTEX_DATA, coded=("OCTAHEDRAL", coded))

    def compressed_size(self, points: Float32Array, triangles: Sequence[NDArray[np.integer]]) -> int:
        """Return the bytes of positions (n, 3), rounded to 12 bits, and of the indices of triangles."""
        low, size = points.min(axis=0), float(np.ptp(points, axis=0).max()) or 1.0
        rows = np.zeros((len(points), 4), "<u2")
        rows[:, :3] = np.rint((points.astype(np.float64) - low) * (4095 / size))
        indices = (np.ascontiguousarray(one.reshape(-1), np.uint32) for one in triangles)
        found = [self._encoder.encode_vertex_buffer(rows, len(rows), rows.itemsize * 4)]
        return sum(map(len, [*found, *(self._encoder.encode_index_buffer(one) for one in indices)]))

    def strips(self, triangles: NDArray[np.integer], rows: int) -> NDArray[np.integer]:
        """Return triangles (n, 3) of `rows` vertices in an order that compression prefers, flattened."""
        flat = np.ascontiguousarray(triangles.reshape(-1), np.uint32)
        found = np.zeros_like(flat)
        if self._encoder is None or not flat.size:
            return flat
        self._encoder.optimize_vertex_cache_strip(found, flat, flat.size, rows)
        return found

    def fractions(
        self,
        values: ArrayLike,
        dtype: str,
        *,
        target: int | None = None,
        bounds: bool = False,
        coded: Coded | None = None,
    ) -> int:
        """Add an accessor of values (n,) or (n, 3) in [-1, 1], stored as normalised integers, and return its index."""
        numbers = np.rint(np.asarray(values, np.float64) * np.iinfo(dtype).max).astype(dtype)
        limits = {"min": numbers.min(axis=0).tolist(), "max": numbers.max(axis=0).tolist()} if bounds else {}
        if numbers.ndim == 2:
            # Rows of vertex data must begin at multiples of four bytes.
            rows = np.zeros((len(numbers), 4), dtype)
            rows[:, :3] = numbers
            view = self.view(rows, target, coded=coded)
        else:
            view = self.view(numbers)
        kind = "VEC3" if numbers.ndim == 2 else "SCALAR"
        return self._accessor(dtype, len(numbers), kind, bufferView=view, normalized=True, **limits)

    def influences(self, joints: NDArray[np.integer]) -> dict[str, int]:
        """Add accessors that bind each vertex (n,) to one joint; return them by attribute name."""
        dtype = "<u1" if joints.max(initial=0) <= np.iinfo(np.uint8).max else "<u2"
        rows, shares = np.zeros((len(joints), 4), dtype), np.zeros((len(joints), 4), np.uint8)
        rows[:, 0], shares[:, 0] = joints, np.iinfo(np.uint8).max
        views = self.view(rows, VERTEX_DATA), self.view(shares, VERTEX_DATA)
        return {
            "JOINTS_0": self._accessor(dtype, len(rows), "VEC4", bufferView=views[0]),
            "WEIGHTS_0": self._accessor("<u1", len(rows), "VEC4", bufferView=views[1], normalized=True),
        }

    def zeros(self, count: int) -> int:
        """Add an accessor of `count` rows of three zeros, which take no bytes, and return its index."""
        return self._accessor("<f4", count, "VEC3", min=[0.0] * 3, max=[0.0] * 3)

    def integers(self, values: ArrayLike, *, target: int | None = None, triangles: bool = False) -> int:
        """Add an accessor of unsigned integers, of 16 bits if they fit, and return its index."""
        numbers = np.asarray(values)
        # The largest value of a type is reserved (it restarts primitives), so no vertex may have it as index.
        dtype = "<u2" if numbers.max(initial=0) < np.iinfo(np.uint16).max else "<u4"
        view = self.view(np.ascontiguousarray(numbers, dtype), target, triangles=triangles)
        return self._accessor(dtype, numbers.size, "SCALAR", bufferView=view)

    def unit_rows(self, frames: int, *, ones_at_end: bool = False) -> int:
        """Add a sparse accessor of ``frames x (frames - 1)`` zeros, with a one at k - 1 in each row k > 0.

        Return its index. With `ones_at_end`, rows have one more column, which is one in every row but the first.
        """
        width = frames - 1 + ones_at_end
        places = np.arange(1, frames) * width + np.arange(frames - 1)
        if ones_at_end:
            places = np.stack([places, np.arange(2, frames + 1) * width - 1], axis=1).reshape(-1)
        sparse = {
            "count": places.size,
            "indices": {"bufferView": self.view(places.astype("<u4")), "componentType": _component("<u4")},
            "values": {"bufferView": self.view(np.ones(places.size, "<f4"))},
        }
        return self._accessor("<f4", frames * width, "SCALAR", sparse=sparse)

    def _accessor(self, dtype: str, count: int, kind: str, **entry: Any) -> int:
        found = {"componentType": _component(dtype), "count": count, "type": kind}
        return self.add("accessors", {**entry, **found})

    def close(self) -> None:
        """Discard the data."""
        self._data.close()

    def save(self, path: Path, *, as_text: bool = False) -> None:
        """Write the file as a GLB, or as JSON with its buffer in base64."""
        self._data.write(bytes(-self._data.tell() % _ALIGNMENT if not as_text else 0))
        length = self._data.tell()
        uri = {"uri": "data:application/octet-stream;base64,"} if as_text else {}
        self.root["buffers"] = [{"byteLength": length, **uri}, *self._others, *self._fallback()]
        text = json_bytes(self.root, allow_nan=False)
        self._data.seek(0)
        with path.open("wb") as file:
            if as_text:
                head, end, tail = text.rpartition(f'"buffers":[{{"byteLength":{length},"uri":"{uri["uri"]}'.encode())
                file.write(head + end)
                while block := self._data.read(COPIED_BYTES):
                    file.write(base64.b64encode(block))
                file.write(tail)
            else:
                text += b" " * (-len(text) % _ALIGNMENT)
                file.write(GLB_HEADER.pack(GLB_MAGIC, 2, GLB_HEADER.size + 2 * CHUNK_HEADER.size + len(text) + length))
                file.write(CHUNK_HEADER.pack(len(text), b"JSON") + text + CHUNK_HEADER.pack(length, b"BIN\0"))
                shutil.copyfileobj(self._data, file, COPIED_BYTES)

    def _fallback(self) -> list[dict[str, Any]]:
        """Return the entry of the placeholder buffer that compressed views decode into; it has no data."""
        if not self._unpacked:
            return []
        return [{"byteLength": self._unpacked, "extensions": {MESHOPT: {"fallback": True}}}]


def _component(dtype: str) -> int:
    return next(number for number, name in COMPONENTS.items() if name == dtype)


def encode_integers(values: ArrayLike) -> str:
    """Encode integers as text for ``extras``, which other programs copy unchanged; they would renumber accessors."""
    numbers = np.asarray(values).astype("<u4")
    return base64.b64encode(zlib.compress(np.diff(numbers, prepend=numbers[:0].sum(dtype="<u4")).tobytes(), 9)).decode()
