"""glTF files: the JSON, the binary chunk of a GLB, and numbers in accessors, in and out."""

from __future__ import annotations

import base64
import binascii
import copy
import hashlib
import importlib
import json
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.errors import InputError, MissingExtraError, naming_file
from pdecodec.formats.base.registry import read_errors
from pdecodec.formats.gltf.compression import DRACO, MESHOPT_NAMES, MOST_DECODED, decode_view
from pdecodec.formats.gltf.types import INSTANCING, POINTER, VISIBILITY, check_types
from pdecodec.mesh.arrays import Float32Array, Int32Array

GLB_HEADER = struct.Struct("<4sII")
CHUNK_HEADER = struct.Struct("<I4s")

GLB_MAGIC = b"glTF"

COMPONENTS: Mapping[int, str] = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""NumPy's names of component types."""

WIDTHS: Mapping[str, int] = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""Numbers in a row, by type."""

READABLE_EXTENSIONS = frozenset({"KHR_mesh_quantization", DRACO, *MESHOPT_NAMES, INSTANCING, POINTER, VISIBILITY})
"""Extensions that may be required because they are read."""

LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "EXT_lights_", "KHR_xmp")
"""Beginnings of the names of extensions that may be required because they change nothing about positions."""

POINTS, LINES, LINE_LOOP, LINE_STRIP, TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN = range(7)
"""Modes of primitives."""

QUANTIZATION, MESHOPT = "KHR_mesh_quantization", "EXT_meshopt_compression"

MESHOPT_VERTEX_VERSION, MESHOPT_STRIDE = 0, 256
"""Version of meshoptimizer's coder of rows that the extension names, and the longest rows."""

MOST_ZEROS = 2**30
"""Bytes that an accessor without data may take: numbers that are all zero take none in a file."""

VERTEX_DATA, INDEX_DATA = 34962, 34963
"""Targets of buffer views: what of a mesh they hold."""

_ALIGNMENT = 4
"""Bytes that parts of a file begin at multiples of."""


@dataclass(frozen=True)
class GltfFile:
    """A file's JSON and its buffers."""

    root: Mapping[str, Any]
    buffers: tuple[bytes, ...]
    _decoded: dict[int, bytes] = field(default_factory=dict)

    def listed(self, kind: str) -> list[Any]:
        """A list of the root, empty where it has none."""
        found = self.root.get(kind, [])
        return found if isinstance(found, list) else []

    def accessor(self, index: int) -> NDArray[Any]:
        """Numbers of an accessor: (n,) or (n, k); normalised integers as float32.

        Raises
        ------
        InputError
            If it, or what it refers to, is not there or too short.
        """
        try:
            return self._accessor(index)
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise InputError(f"accessor {index} is damaged or missing ({error}); export the file again") from error

    def _accessor(self, index: int) -> NDArray[Any]:
        entry = self.root["accessors"][index]
        dtype, width, count = np.dtype(COMPONENTS[entry["componentType"]]), WIDTHS[entry["type"]], int(entry["count"])
        if count < 0:
            raise ValueError(f"{count} rows")
        if "bufferView" in entry:
            values = self._rows(entry["bufferView"], int(entry.get("byteOffset", 0)), dtype, width, count)
        else:
            if count * width * dtype.itemsize > MOST_ZEROS:
                raise ValueError(f"{count} rows of zeros")
            values = np.zeros((count, width), dtype)
        if "sparse" in entry:
            sparse = entry["sparse"]
            where, what, changed = sparse["indices"], sparse["values"], int(sparse["count"])
            kind = np.dtype(COMPONENTS[where["componentType"]])
            rows = self._rows(where["bufferView"], int(where.get("byteOffset", 0)), kind, 1, changed)[:, 0]
            values = values.copy()
            values[rows] = self._rows(what["bufferView"], int(what.get("byteOffset", 0)), dtype, width, changed)
        values = as_declared(values, entry)
        return values[:, 0] if width == 1 else values

    def _rows(self, view_index: int, offset: int, dtype: np.dtype[Any], width: int, count: int) -> NDArray[Any]:
        view, data, first, end = self._view(view_index)
        start = first + offset
        size = width * dtype.itemsize
        stride = int(view.get("byteStride", 0)) or size
        if offset < 0 or count < 0 or stride < size or (count and start + (count - 1) * stride + size > end):
            raise ValueError("it ends after its buffer view")
        if end > len(data) or start > len(data):
            raise ValueError("its buffer view ends after its buffer")
        raw = np.frombuffer(data, np.uint8, offset=start, count=min(len(data) - start, count * stride))
        raw = np.concatenate([raw, np.zeros(count * stride - raw.size, np.uint8)]) if raw.size < count * stride else raw
        rows = np.ascontiguousarray(raw.reshape(count, stride)[:, :size]).view(dtype)
        return rows.reshape(count, width)

    def _view(self, index: int) -> tuple[Mapping[str, Any], bytes, int, int]:
        """A buffer view, the bytes it lies in, and where it begins and ends there."""
        view = self.root["bufferViews"][index]
        packed = next((view["extensions"][name] for name in MESHOPT_NAMES if name in view.get("extensions", {})), None)
        if packed is None:
            first = int(view.get("byteOffset", 0))
            return view, self.buffers[view["buffer"]], first, first + int(view["byteLength"])
        if index not in self._decoded:
            left = MOST_DECODED - sum(map(len, self._decoded.values()))
            self._decoded[index] = decode_view(_part(self.buffers[packed["buffer"]], packed), packed, left)
        return view, self._decoded[index], 0, len(self._decoded[index])

    def view_bytes(self, index: int) -> bytes:
        """The bytes of a buffer view; errors as of :meth:`accessor`."""
        try:
            _, data, first, end = self._view(index)
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise InputError(f"buffer view {index} is damaged or missing ({error}); export it again") from error
        return data[first:end]


def as_declared(values: NDArray[Any], entry: Mapping[str, Any]) -> NDArray[Any]:
    """Rows of an accessor, integers that its entry calls normalised as float32."""
    if not entry.get("normalized") or values.dtype.kind not in "iu":
        return values
    shares: Float32Array = values.astype(np.float32) / np.float32(np.iinfo(values.dtype).max)
    return np.maximum(shares, np.float32(-1))


def _part(data: bytes, entry: Mapping[str, Any]) -> bytes:
    """The bytes of a buffer that an entry with an offset and a length stands for."""
    first, length = int(entry.get("byteOffset", 0)), int(entry["byteLength"])
    if first < 0 or length < 0 or first + length > len(data):
        raise ValueError("its bytes end after their buffer")
    return data[first : first + length]


def read_gltf(path: Path) -> GltfFile:
    """Read a ``.gltf`` or ``.glb`` file and the buffers that it names.

    Raises
    ------
    InputError
        If it is no glTF 2.0 file, is damaged, or needs an extension that is not read.
    """
    with read_errors(path):
        data = path.read_bytes()
    text, chunk = _split_glb(data, path) if data.startswith(GLB_MAGIC) else (data, None)
    try:
        root = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"is no glTF file, or a damaged one ({error}); export it again", path=path) from error
    asset = root.get("asset", {}) if isinstance(root, dict) else {}
    version = asset.get("version") if isinstance(asset, dict) else None
    if not (isinstance(version, str) and version.startswith("2.")):
        raise InputError(f"is no glTF 2.0 file (its version is {version}); export it again", path=path)
    with naming_file(path):
        root = check_types(root)
    required = root.get("extensionsRequired", [])
    missing = [name for name in required if name not in READABLE_EXTENSIONS and not name.startswith(LOOKS)]
    if missing:
        raise InputError(f"needs {', '.join(missing)}, which is not read; export it without", path=path)
    buffers = tuple(_buffer(entry, index, chunk, path) for index, entry in enumerate(root.get("buffers", [])))
    return GltfFile(root, buffers)


def _split_glb(data: bytes, path: Path) -> tuple[bytes, bytes | None]:
    """JSON and binary chunk of a GLB."""
    damaged = InputError("is a damaged GLB file: its chunks do not fit; export it again", path=path)
    if len(data) < GLB_HEADER.size:
        raise damaged
    _, version, length = GLB_HEADER.unpack_from(data)
    if version != 2 or length > len(data):
        raise damaged
    chunks: dict[bytes, bytes] = {}
    at = GLB_HEADER.size
    while at + CHUNK_HEADER.size <= length:
        size, kind = CHUNK_HEADER.unpack_from(data, at)
        at += CHUNK_HEADER.size
        if at + size > length:
            raise damaged
        chunks.setdefault(kind, data[at : at + size])
        at += size
    if b"JSON" not in chunks:
        raise damaged
    return chunks[b"JSON"], chunks.get(b"BIN\0")


def _buffer(entry: Mapping[str, Any], index: int, chunk: bytes | None, path: Path) -> bytes:
    uri = entry.get("uri")
    if uri is None:
        if any(name in entry.get("extensions", {}) for name in MESHOPT_NAMES):
            # Only the size of what compressed views become.
            return b""
        if chunk is None:
            raise InputError(f"buffer {index} has no data; export the file again", path=path)
        return chunk
    if uri.startswith("data:"):
        try:
            return base64.b64decode(uri.partition(",")[2], validate=True)
        except binascii.Error as error:
            raise InputError(f"buffer {index} is damaged ({error}); export the file again", path=path) from error
    if "://" in uri:
        raise InputError(f"buffer {index} lies elsewhere ({uri[:60]}); export the file with its data", path=path)
    beside = path.parent / unquote(uri)
    try:
        return beside.read_bytes()
    except OSError as error:
        raise InputError(f"its buffer {beside.name} cannot be read ({error.strerror})", path=path) from error


class GltfBuilder:
    """Collects nodes, meshes and numbers.

    Parameters
    ----------
    meshopt : bool
        Whether numbers are compressed by meshoptimizer, without loss; viewers must know the extension then.

    Raises
    ------
    MissingExtraError
        If meshoptimizer is not installed.
    """

    def __init__(self, *, meshopt: bool = False) -> None:
        self.root: dict[str, Any] = {"asset": {"version": "2.0", "generator": "pdecodec"}}
        self._data = bytearray()
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

    def begin_with(self, file: GltfFile) -> None:
        """Take all that a file has, its buffers joined to one, before anything is added."""
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
        """Name an extension without which the file cannot be shown."""
        for kind in ("extensionsUsed", "extensionsRequired"):
            names = self.root.setdefault(kind, [])
            if extension not in names:
                names.append(extension)

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Put an entry at the end of a list of the root; its index."""
        entries = self.root.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def view(self, data: NDArray[Any], target: int | None = None, *, triangles: bool = False) -> int:
        """A buffer view of an array, a row each; its index. `triangles` may be turned, but stay what they are."""
        entry: dict[str, Any] = {"buffer": 0, "byteLength": data.nbytes}
        stride = data.nbytes // max(1, len(data))
        if target is not None:
            entry["target"] = target
        if data.ndim == 2 and data.dtype.kind in "iu":
            # Rows are longer than what they hold.
            entry["byteStride"] = stride
        packed = self._packed(data, stride, triangles=triangles)
        if packed is None:
            entry["byteOffset"] = self._append(data.tobytes())
        else:
            mode, found = packed
            entry |= {"buffer": 1 + len(self._others), "byteOffset": self._unpacked}
            self._unpacked += data.nbytes + -data.nbytes % _ALIGNMENT
            place = {"buffer": 0, "byteOffset": self._append(found), "byteLength": len(found)}
            entry["extensions"] = {MESHOPT: {**place, "byteStride": stride, "count": len(data), "mode": mode}}
        return self.add("bufferViews", entry)

    def _append(self, data: bytes) -> int:
        self._data += bytes(-len(self._data) % _ALIGNMENT)
        self._data += data
        return len(self._data) - len(data)

    def _packed(self, data: NDArray[Any], stride: int, *, triangles: bool) -> tuple[str, bytes] | None:
        """Mode and bytes of compressed rows; None where they would not be fewer."""
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

    def floats(self, values: ArrayLike, *, target: int | None = None, bounds: bool = False) -> int:
        """An accessor of float32 rows, with their bounds where they are asked for; its index."""
        rows = np.ascontiguousarray(values, "<f4")
        table = rows.reshape(len(rows), -1) if rows.size else rows.reshape(len(rows), 1)
        limits = {"min": table.min(axis=0).tolist(), "max": table.max(axis=0).tolist()} if bounds else {}
        kind = next(name for name, numbers in WIDTHS.items() if numbers == table.shape[1])
        return self._accessor("<f4", len(rows), kind, bufferView=self.view(rows, target), **limits)

    def fractions(self, values: ArrayLike, dtype: str, *, target: int | None = None, bounds: bool = False) -> int:
        """An accessor of numbers (n,) or (n, 3) from -1 (or 0) to 1, as integers of a NumPy type; its index."""
        numbers = np.rint(np.asarray(values, np.float64) * np.iinfo(dtype).max).astype(dtype)
        limits = {"min": numbers.min(axis=0).tolist(), "max": numbers.max(axis=0).tolist()} if bounds else {}
        if numbers.ndim == 2:
            # Rows of vertices begin at multiples of four bytes.
            rows = np.zeros((len(numbers), 4), dtype)
            rows[:, :3] = numbers
            view = self.view(rows, target)
        else:
            view = self.view(numbers)
        kind = "VEC3" if numbers.ndim == 2 else "SCALAR"
        return self._accessor(dtype, len(numbers), kind, bufferView=view, normalized=True, **limits)

    def zeros(self, count: int) -> int:
        """An accessor of so many rows of three zeros, which take no bytes; its index."""
        return self._accessor("<f4", count, "VEC3", min=[0.0] * 3, max=[0.0] * 3)

    def integers(self, values: ArrayLike, *, target: int | None = None, triangles: bool = False) -> int:
        """An accessor of unsigned numbers, of 16 bits where that is enough; its index."""
        numbers = np.asarray(values)
        # The largest number of a type is none of a vertex.
        dtype = "<u2" if numbers.max(initial=0) < np.iinfo(np.uint16).max else "<u4"
        view = self.view(np.ascontiguousarray(numbers, dtype), target, triangles=triangles)
        return self._accessor(dtype, numbers.size, "SCALAR", bufferView=view)

    def unit_rows(self, frames: int, *, ones_at_end: bool = False) -> int:
        """An accessor of ``frames x (frames - 1)`` numbers: row k has a one at k - 1; its index.

        With a one at the end of every row but the first, rows are longer by one.
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

    def to_glb(self) -> bytes:
        """The file as one binary."""
        self._data += bytes(-len(self._data) % _ALIGNMENT)
        self.root["buffers"] = [{"byteLength": len(self._data)}, *self._others, *self._fallback()]
        text = self._json()
        text += b" " * (-len(text) % _ALIGNMENT)
        length = GLB_HEADER.size + 2 * CHUNK_HEADER.size + len(text) + len(self._data)
        parts = (
            GLB_HEADER.pack(GLB_MAGIC, 2, length),
            CHUNK_HEADER.pack(len(text), b"JSON"),
            text,
            CHUNK_HEADER.pack(len(self._data), b"BIN\0"),
            self._data,
        )
        return b"".join(parts)

    def _fallback(self) -> list[dict[str, Any]]:
        """The buffer that compressed views become; it holds nothing."""
        if not self._unpacked:
            return []
        return [{"byteLength": self._unpacked, "extensions": {MESHOPT: {"fallback": True}}}]

    def to_gltf(self) -> bytes:
        """The file as JSON, the numbers in it as text."""
        uri = "data:application/octet-stream;base64," + base64.b64encode(self._data).decode("ascii")
        self.root["buffers"] = [{"byteLength": len(self._data), "uri": uri}, *self._others, *self._fallback()]
        return self._json()

    def _json(self) -> bytes:
        return json.dumps(self.root, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()


def _component(dtype: str) -> int:
    return next(number for number, name in COMPONENTS.items() if name == dtype)


def fingerprint(rows: int, primitives: Sequence[tuple[int, NDArray[np.integer]]]) -> str:
    """What tells a mesh from another one: of how many rows it has, and the mode and indices of each primitive.

    With which of its corners a triangle begins does not count: compression begins with another.
    """
    digest = hashlib.blake2b(str(rows).encode(), digest_size=12)
    for mode, indices in primitives:
        if mode == TRIANGLES and indices.size % 3 == 0:
            corners = indices.reshape(-1, 3)
            first = corners.argmin(axis=1, keepdims=True)
            indices = np.take_along_axis(corners, (first + np.arange(3)) % 3, axis=1)
        digest.update(f" {mode} {indices.size} ".encode() + indices.astype("<u4").tobytes())
    return digest.hexdigest()


def noted_integers(values: ArrayLike) -> str:
    """Integers as text for ``extras``, which programs hand on as they are: accessors there would be renumbered."""
    numbers = np.asarray(values).astype("<u4")
    return base64.b64encode(zlib.compress(np.diff(numbers, prepend=numbers[:0].sum(dtype="<u4")).tobytes(), 9)).decode()


def read_integers(text: str, most: int) -> Int32Array:
    """Undo :func:`noted_integers`: (n,) int32, at most `most` of them; ValueError where it is something else."""
    try:
        data = zlib.decompressobj().decompress(base64.b64decode(text, validate=True), 4 * most + 1)
    except (binascii.Error, zlib.error) as error:
        raise ValueError(str(error)) from error
    if len(data) > 4 * most:
        raise ValueError(f"more than {most} numbers are noted")
    return np.cumsum(np.frombuffer(data, "<u4"), dtype="<u4").astype(np.int32)


def flipped(uv: Float32Array) -> Float32Array:
    """UVs with the second number from the other side: glTF counts it from the top, the others from the bottom."""
    turned = uv.astype(np.float32)
    turned[:, 1] = np.float32(1) - turned[:, 1]
    return turned
