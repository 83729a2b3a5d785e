"""Read glTF files: the JSON, the binary chunk of a GLB, and the values of accessors."""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import damaged, naming_file
from pdecodec.formats.base.registry import read_errors
from pdecodec.formats.gltf.compression import DRACO, MAX_DECODED_BYTES, MESHOPT_NAMES, decode_view
from pdecodec.formats.gltf.types import INSTANCING, MESH_MOTION, POINTER, VISIBILITY, check_types
from pdecodec.mesh.arrays import Float32Array, Int32Array
from pdecodec.system.reading import FileScope, read_regular

GLB_HEADER = struct.Struct("<4sII")


CHUNK_HEADER = struct.Struct("<I4s")


GLB_MAGIC = b"glTF"


COMPONENTS: Mapping[int, str] = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""NumPy dtypes by glTF's component types."""


WIDTHS: Mapping[str, int] = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""Values per row by accessor type."""


READABLE_EXTENSIONS = frozenset(
    {"KHR_mesh_quantization", DRACO, *MESHOPT_NAMES, INSTANCING, POINTER, VISIBILITY, MESH_MOTION}
)
"""Extensions that a file may require because this reader supports them."""


POSITION_NEUTRAL_PREFIXES = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "EXT_lights_", "KHR_xmp")
"""Prefixes of extensions that a file may require because they do not affect positions."""


POINTS, LINES, LINE_LOOP, LINE_STRIP, TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN = range(7)
"""Modes of primitives, numbered as in glTF."""


MAX_ZERO_BYTES = 2**30
"""Largest size of an accessor without data [bytes]: it holds zeros, which take no room in a file."""


@dataclass(frozen=True)
class GltfFile:
    """The JSON of a file and its buffers."""

    root: Mapping[str, Any]
    buffers: tuple[bytes, ...]
    _decoded: dict[int, bytes] = field(default_factory=dict)

    def listed(self, kind: str) -> list[Any]:
        """Return a list of the root; an empty one if the root does not have it."""
        found = self.root.get(kind, [])
        return found if isinstance(found, list) else []

    def accessor(self, index: int) -> NDArray[Any]:
        """Return the values of an accessor, (n,) or (n, k); normalised integers become float32.

        Raises
        ------
        InputError
            If the accessor, or data that it refers to, is missing or too short.
        """
        try:
            return self._accessor(index)
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise damaged(f"accessor {index} is damaged or missing ({error}); export the file again") from error

    def _accessor(self, index: int) -> NDArray[Any]:
        entry = self.root["accessors"][index]
        dtype, width, count = np.dtype(COMPONENTS[entry["componentType"]]), WIDTHS[entry["type"]], int(entry["count"])
        if count < 0:
            raise ValueError(f"{count} rows")
        if "bufferView" in entry:
            values = self._rows(entry["bufferView"], int(entry.get("byteOffset", 0)), dtype, width, count)
        else:
            if count * width * dtype.itemsize > MAX_ZERO_BYTES:
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

    def stored_rows(self, index: int) -> tuple[NDArray[Any], int | None]:
        """Return the rows (n, k) of an accessor without sparse ones, as they are stored, and its view's target."""
        entry = self.root["accessors"][index]
        dtype, width = np.dtype(COMPONENTS[entry["componentType"]]), WIDTHS[entry["type"]]
        rows = self._rows(entry["bufferView"], int(entry.get("byteOffset", 0)), dtype, width, int(entry["count"]))
        return rows, self.root["bufferViews"][entry["bufferView"]].get("target")

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
        """Return the entry of a buffer view, the bytes that hold it, and the offsets of its begin and end in them."""
        view = self.root["bufferViews"][index]
        packed = next((view["extensions"][name] for name in MESHOPT_NAMES if name in view.get("extensions", {})), None)
        if packed is None:
            first = int(view.get("byteOffset", 0))
            return view, self.buffers[view["buffer"]], first, first + int(view["byteLength"])
        if index not in self._decoded:
            left = MAX_DECODED_BYTES - sum(map(len, self._decoded.values()))
            self._decoded[index] = decode_view(_entry_bytes(self.buffers[packed["buffer"]], packed), packed, left)
        return view, self._decoded[index], 0, len(self._decoded[index])

    def view_bytes(self, index: int) -> bytes:
        """Return the bytes of a buffer view; raises as :meth:`accessor`."""
        try:
            _, data, first, end = self._view(index)
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise damaged(f"buffer view {index} is damaged or missing ({error}); export it again") from error
        return data[first:end]


def json_bytes(root: Any, *, allow_nan: bool = True) -> bytes:
    """Return JSON as UTF-8; with escapes if a text has half a surrogate pair, which UTF-8 cannot hold."""
    try:
        return json.dumps(root, separators=(",", ":"), ensure_ascii=False, allow_nan=allow_nan).encode()
    except UnicodeEncodeError:
        return json.dumps(root, separators=(",", ":"), allow_nan=allow_nan).encode()


def as_declared(values: NDArray[Any], entry: Mapping[str, Any]) -> NDArray[Any]:
    """Return rows of an accessor, converted to float32 if its entry declares normalised integers."""
    if not entry.get("normalized") or values.dtype.kind not in "iu":
        return values
    shares: Float32Array = values.astype(np.float32) / np.float32(np.iinfo(values.dtype).max)
    return np.maximum(shares, np.float32(-1))


def _entry_bytes(data: bytes, entry: Mapping[str, Any]) -> bytes:
    """Return the bytes of a buffer that an entry selects by offset and length."""
    first, length = int(entry.get("byteOffset", 0)), int(entry["byteLength"])
    if first < 0 or length < 0 or first + length > len(data):
        raise ValueError("its bytes end after their buffer")
    return data[first : first + length]


def named_buffers(path: Path) -> list[str]:
    """Return the names of the external buffer files of a ``.gltf`` file; ValueError or similar if it is not valid."""
    if path.suffix.lower() != ".gltf":
        return []
    uris = [str(one.get("uri", "")) for one in json.loads(read_regular(path)).get("buffers", [])]
    return [unquote(uri) for uri in uris if not uri.startswith("data:")]


def read_gltf(path: Path) -> GltfFile:
    """Read a ``.gltf`` or ``.glb`` file and the buffers that it names.

    Raises
    ------
    InputError
        If it is not a glTF 2.0 file, is damaged, or needs an extension that is not read.
    """
    with read_errors(path):
        data = read_regular(path)
    text, chunk = _split_glb(data, path) if data.startswith(GLB_MAGIC) else (data, None)
    try:
        root = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise damaged(f"is not a glTF file, or is damaged ({error}); export it again", path=path) from error
    asset = root.get("asset", {}) if isinstance(root, dict) else {}
    version = asset.get("version") if isinstance(asset, dict) else None
    if not (isinstance(version, str) and version.startswith("2.")):
        raise damaged(f"is not a glTF 2.0 file (its version is {version}); export it again", path=path)
    with naming_file(path):
        root = check_types(root)
    required = root.get("extensionsRequired", [])
    missing = [
        name for name in required if name not in READABLE_EXTENSIONS and not name.startswith(POSITION_NEUTRAL_PREFIXES)
    ]
    if missing:
        raise damaged(f"needs {', '.join(missing)}, which is not read; export it without", path=path)
    scope = FileScope(path)
    buffers = tuple(_buffer(entry, index, chunk, scope) for index, entry in enumerate(root.get("buffers", [])))
    return GltfFile(root, buffers)


def _split_glb(data: bytes, path: Path) -> tuple[bytes, bytes | None]:
    """Return the JSON and the binary chunk of a GLB."""
    broken = damaged("is a damaged GLB file: its chunks do not fit; export it again", path=path)
    if len(data) < GLB_HEADER.size:
        raise broken
    _, version, length = GLB_HEADER.unpack_from(data)
    if version != 2 or length > len(data):
        raise broken
    chunks: dict[bytes, bytes] = {}
    at = GLB_HEADER.size
    while at + CHUNK_HEADER.size <= length:
        size, kind = CHUNK_HEADER.unpack_from(data, at)
        at += CHUNK_HEADER.size
        if at + size > length:
            raise broken
        chunks.setdefault(kind, data[at : at + size])
        at += size
    if b"JSON" not in chunks:
        raise broken
    return chunks[b"JSON"], chunks.get(b"BIN\0")


def _buffer(entry: Mapping[str, Any], index: int, chunk: bytes | None, scope: FileScope) -> bytes:
    uri, path = entry.get("uri"), scope.path
    if uri is None:
        if any(name in entry.get("extensions", {}) for name in MESHOPT_NAMES):
            # The placeholder buffer of compressed views has a size but no data.
            return b""
        if chunk is None:
            raise damaged(f"buffer {index} has no data; export the file again", path=path)
        return chunk
    if uri.startswith("data:"):
        try:
            return base64.b64decode(uri.partition(",")[2], validate=True)
        except binascii.Error as error:
            raise damaged(f"buffer {index} is damaged ({error}); export the file again", path=path) from error
    if "://" in uri:
        raise damaged(f"buffer {index} is on the network ({uri[:60]}); export the file with its data", path=path)
    return scope.read(unquote(uri), entry.get("byteLength"))


def fingerprint(rows: int, primitives: Sequence[tuple[int, NDArray[np.integer]]]) -> str:
    """Return a digest that identifies a mesh by its number of rows and the mode and indices of each primitive.

    It does not depend on which corner a triangle begins with: compression may change that.
    """
    digest = hashlib.blake2b(str(rows).encode(), digest_size=12)
    for mode, indices in primitives:
        if mode == TRIANGLES and indices.size % 3 == 0:
            corners = indices.reshape(-1, 3)
            first = corners.argmin(axis=1, keepdims=True)
            indices = np.take_along_axis(corners, (first + np.arange(3)) % 3, axis=1)
        digest.update(f" {mode} {indices.size} ".encode() + indices.astype("<u4").tobytes())
    return digest.hexdigest()


def read_integers(text: str, most: int) -> Int32Array:
    """Decode :func:`encode_integers`: (n,) int32; ValueError if invalid or more than `most` values."""
    try:
        data = zlib.decompressobj().decompress(base64.b64decode(text, validate=True), 4 * most + 1)
    except (binascii.Error, zlib.error) as error:
        raise ValueError(str(error)) from error
    if len(data) > 4 * most:
        raise ValueError(f"more than {most} values are recorded")
    return np.cumsum(np.frombuffer(data, "<u4"), dtype="<u4").astype(np.int32)


def flipped(uv: Float32Array) -> Float32Array:
    """Return UVs with V mirrored: glTF measures V from the top, the other formats from the bottom."""
    turned = uv.astype(np.float32)
    turned[:, 1] = np.float32(1) - turned[:, 1]
    return turned
