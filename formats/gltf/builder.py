"""Build a glTF file: collect nodes, meshes and accessors, then lay them out as JSON and bytes."""

from __future__ import annotations

import base64
import copy
import hashlib
import io
import shutil
import tempfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.formats.gltf.file import (
    CHUNK_HEADER,
    COMPONENTS,
    GLB_HEADER,
    GLB_MAGIC,
    WIDTHS,
    GltfFile,
    json_bytes,
)
from pdecodec.formats.gltf.packing import Coded, Packer, exponential, octahedral, quaternions
from pdecodec.formats.gltf.references import ALIGNMENT, copy_views, drop_unused
from pdecodec.mesh.arrays import Float32Array, Int64Array

QUANTIZATION, MESHOPT = "KHR_mesh_quantization", "EXT_meshopt_compression"

VERTEX_DATA, INDEX_DATA = 34962, 34963
"""glTF's codes for the content of a buffer view (``target``): vertex attributes, vertex indices."""

HELD_BYTES, COPIED_BYTES = 2**22, 3 * 2**18
"""Bytes of data that are held in memory before they go to a temporary file, and bytes that are copied at once."""

SHARED_BYTES = 2**20
"""Bytes of rows that are compressed as one buffer view; they are held in memory until then."""


@dataclass
class _SharedView:
    """A buffer view for rows of several accessors, which are compressed together.

    Attributes
    ----------
    index : int
        Its index in the file.
    entry : dict
    filter : str or None
        The filter of meshoptimizer that `coded` is in the form of.
    is_triangles : bool
    rows, coded : list of array
        Rows as viewers see them, and in the form in which they are compressed.
    size : int
        Size of the rows [bytes].
    """

    index: int
    entry: dict[str, Any]
    filter: str | None
    is_triangles: bool
    rows: list[NDArray[Any]] = field(default_factory=list)
    coded: list[NDArray[Any]] = field(default_factory=list)
    size: int = 0


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
        self._compressed: list[dict[str, Any]] = []
        self._source: GltfFile | None = None
        self._kept: list[dict[str, Any]] = []
        self._packer = Packer() if meshopt else None
        self._shared: dict[tuple[object, ...], _SharedView] = {}
        self._places: dict[bytes, dict[str, int]] = {}
        self._accessors: dict[str, int] = {}
        if meshopt:
            self.require(MESHOPT)

    @property
    def packer(self) -> Packer | None:
        """What compresses the data."""
        return self._packer

    def begin_with(self, file: GltfFile) -> None:
        """Start with everything that an existing file holds. Call this before adding anything."""
        mine = self.root.get("extensionsRequired", ())
        self.root = copy.deepcopy(dict(file.root))
        for extension in mine:
            self.require(extension)
        self._source, self._kept = file, list(self.root.get("bufferViews", ()))

    def drop_unused(self) -> None:
        """Drop accessors and buffer views of the existing file that nothing refers to any more."""
        assert self._source is not None
        drop_unused(self.root, self._source, self._place)

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

    def view(self, data: NDArray[Any], target: int | None = None) -> int:
        """Add a buffer view with one row per item of an array, uncompressed, and return its index."""
        entry: dict[str, Any] = {"buffer": 0, "byteLength": data.nbytes}
        if target is not None:
            entry["target"] = target
        if data.ndim == 2 and data.dtype.kind in "iu":
            # Rows are padded to multiples of four bytes, so the stride has to be declared.
            entry["byteStride"] = data.nbytes // max(1, len(data))
        entry["byteOffset"] = self._append(np.ascontiguousarray(data).data)
        return self.add("bufferViews", entry)

    def _place(
        self,
        data: NDArray[Any],
        target: int | None = None,
        *,
        triangles: bool = False,
        coded: Coded | None = None,
    ) -> dict[str, int]:
        """Add one row per item of an array; return the members of an accessor that say where they are.

        Compressed, rows of one kind share a buffer view, and equal rows are stored once. If `triangles` is true,
        compression may rotate the order of each triangle's corners. `coded` names a filter of meshoptimizer, and
        what is compressed in its form in place of `data`.
        """
        if self._packer is None or not data.size:
            return {"bufferView": self.view(data, target)}
        name, rows = coded or (None, data)
        stride = data.nbytes // len(data)
        kind = (data.dtype.str, data.shape[1:], target, triangles, name)
        digest = hashlib.sha256(repr(kind).encode() + data.tobytes()).digest()
        if digest in self._places:
            return self._places[digest]
        view = self._shared.get(kind)
        if view is None:
            entry: dict[str, Any] = {}
            if data.ndim == 2 and target == VERTEX_DATA:
                entry["byteStride"] = stride
            view = self._shared[kind] = _SharedView(self.add("bufferViews", entry), entry, name, triangles)
        self._places[digest] = {"bufferView": view.index, **({"byteOffset": view.size} if view.size else {})}
        view.rows.append(data)
        view.coded.append(rows)
        view.size += data.nbytes
        if view.size >= SHARED_BYTES:
            self._compress(self._shared.pop(kind))
        return self._places[digest]

    def _compress(self, view: _SharedView) -> None:
        """Write the rows of a shared buffer view."""
        assert self._packer is not None
        data, rows = np.concatenate(view.rows), np.concatenate(view.coded)
        packed = self._packer.pack(rows, triangles=view.is_triangles)
        if packed is None:
            view.entry |= {"buffer": 0, "byteLength": data.nbytes, "byteOffset": self._append(data.data)}
            return
        mode, found = packed
        view.entry |= {"byteLength": data.nbytes, "byteOffset": self._unpacked}
        self._compressed.append(view.entry)
        self._unpacked += data.nbytes + -data.nbytes % ALIGNMENT
        place = {"buffer": 0, "byteOffset": self._append(found), "byteLength": len(found)}
        view.entry["extensions"] = {
            MESHOPT: {**place, "byteStride": data.nbytes // len(data), "count": len(data), "mode": mode}
        }
        if view.filter is not None:
            view.entry["extensions"][MESHOPT]["filter"] = view.filter

    def _append(self, data: bytes | memoryview) -> int:
        self._data.write(bytes(-self._data.tell() % ALIGNMENT))
        offset = self._data.tell()
        self._data.write(data)
        if isinstance(self._data, io.BytesIO) and self._data.tell() > HELD_BYTES:
            held, self._data = self._data, tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115 - closed by close()
            self._data.write(held.getbuffer())
        return offset

    def numbers(self, values: ArrayLike) -> list[float]:
        """Return float32 numbers for the JSON; compressed, with the fewest digits that tell them apart."""
        rows = np.asarray(values, np.float32).reshape(-1)
        return rows.tolist() if self._packer is None else [float(str(one)) for one in rows]

    def floats(
        self,
        values: ArrayLike,
        *,
        target: int | None = None,
        bounds: bool = False,
        coded: Coded | None = None,
    ) -> int:
        """Add an accessor of float32 rows, on request with their minimum and maximum, and return its index.

        `coded` is the filter of meshoptimizer that the rows are compressed with, and the rows in its form.
        """
        rows = np.ascontiguousarray(values, "<f4")
        table = rows.reshape(len(rows), -1) if rows.size else rows.reshape(len(rows), 1)
        limits = {"min": self.numbers(table.min(axis=0)), "max": self.numbers(table.max(axis=0))} if bounds else {}
        kind = next(name for name, numbers in WIDTHS.items() if numbers == table.shape[1])
        return self._accessor("<f4", len(rows), kind, **self._place(rows, target, coded=coded), **limits)

    def rounded(self, values: ArrayLike, step: float | None, *, target: int | None = None, bounds: bool = False) -> int:
        """Add an accessor of float32 rows (n, k) like :meth:`floats`; compressed, they are rounded to a step.

        Values become multiples of the power of two at or below `step`, unless these need too many digits.
        """
        rows, coded = np.asarray(values, np.float32), None
        if step and self._packer is not None and rows.size and np.isfinite(rows).all():
            rows, coded = exponential(rows, step)
        return self.floats(rows, target=target, bounds=bounds, coded=coded)

    def directions(self, normals: Float32Array) -> tuple[int, NDArray[np.floating]]:
        """Add an accessor of unit vectors (n, 3) of 8 bits; compressed, they are points of an octahedron.

        Return its index, and the vectors as they are stored.
        """
        if self._packer is None:
            found = np.rint(normals * 127) / 127
            return self.fractions(normals, "<i1", target=VERTEX_DATA), found
        found, coded = octahedral(normals)
        return self.fractions(found, "<i1", target=VERTEX_DATA, coded=coded), found

    def turns(self, values: Float32Array, largest_angle: float) -> int:
        """Add an accessor of unit quaternions (n, 4); compressed, rounded by at most an angle [radians]."""
        found = None if self._packer is None else quaternions(values, largest_angle)
        return self.floats(values) if found is None else self.fractions(found[0], "<i2", coded=found[1])

    def fractions(
        self,
        values: ArrayLike,
        dtype: str,
        *,
        target: int | None = None,
        bounds: bool = False,
        coded: Coded | None = None,
    ) -> int:
        """Add an accessor of values (n,), (n, 3) or (n, 4) in [-1, 1], stored as normalised integers.

        Return its index.
        """
        numbers = np.rint(np.asarray(values, np.float64) * np.iinfo(dtype).max).astype(dtype)
        limits = {"min": numbers.min(axis=0).tolist(), "max": numbers.max(axis=0).tolist()} if bounds else {}
        rows, kind = numbers, "SCALAR"
        if numbers.ndim == 2:
            # Rows of vertex data must begin at multiples of four bytes.
            rows, kind = np.zeros((len(numbers), 4), dtype), f"VEC{numbers.shape[1]}"
            rows[:, : numbers.shape[1]] = numbers
        place = self._place(rows, target, coded=coded)
        return self._accessor(dtype, len(numbers), kind, **place, normalized=True, **limits)

    def influences(self, joints: NDArray[np.integer]) -> dict[str, int]:
        """Add accessors that bind each vertex (n,) to one joint; return them by attribute name."""
        dtype = "<u1" if joints.max(initial=0) <= np.iinfo(np.uint8).max else "<u2"
        rows, shares = np.zeros((len(joints), 4), dtype), np.zeros((len(joints), 4), np.uint8)
        rows[:, 0], shares[:, 0] = joints, np.iinfo(np.uint8).max
        bound, strengths = self._place(rows, VERTEX_DATA), self._place(shares, VERTEX_DATA)
        return {
            "JOINTS_0": self._accessor(dtype, len(rows), "VEC4", **bound),
            "WEIGHTS_0": self._accessor("<u1", len(rows), "VEC4", **strengths, normalized=True),
        }

    def zeros(self, count: int) -> int:
        """Add an accessor of `count` rows of three zeros, which take no bytes, and return its index."""
        return self._accessor("<f4", count, "VEC3", min=[0.0] * 3, max=[0.0] * 3)

    def integers(self, values: ArrayLike, *, target: int | None = None, triangles: bool = False) -> int:
        """Add an accessor of unsigned integers, of 16 bits if they fit, and return its index."""
        numbers = np.asarray(values)
        # The largest value of a type is reserved (it restarts primitives), so no vertex may have it as index.
        dtype = "<u2" if numbers.max(initial=0) < np.iinfo(np.uint16).max else "<u4"
        place = self._place(np.ascontiguousarray(numbers, dtype), target, triangles=triangles)
        return self._accessor(dtype, numbers.size, "SCALAR", **place)

    def numbering(self, values: Int64Array) -> int:
        """Add an accessor of unsigned integers that mostly grow by little, of 32 bits if compression prefers them."""
        wide = np.ascontiguousarray(values, "<u4")
        if self._packer is None or not wide.size or self._packer.numbering(wide)[0] != "ATTRIBUTES":
            return self.integers(values)
        return self._accessor("<u4", wide.size, "SCALAR", **self._place(wide))

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
            "indices": {**self._place(places.astype("<u4")), "componentType": _component("<u4")},
            "values": self._place(np.ones(places.size, "<f4")),
        }
        return self._accessor("<f4", frames * width, "SCALAR", sparse=sparse)

    def _accessor(self, dtype: str, count: int, kind: str, **entry: Any) -> int:
        found = {**entry, "componentType": _component(dtype), "count": count, "type": kind}
        if self._packer is None:
            return self.add("accessors", found)
        key = repr(found)
        if key not in self._accessors:
            self._accessors[key] = self.add("accessors", found)
        return self._accessors[key]

    def close(self) -> None:
        """Discard the data."""
        self._data.close()

    def save(self, path: Path, *, as_text: bool = False) -> None:
        """Write the file as a GLB, or as JSON with its buffer in base64."""
        if self._source is not None:
            there = {id(one) for one in self.root.get("bufferViews", ())}
            kept = [one for one in self._kept if id(one) in there]
            self._others = copy_views(self._source, kept, self._append)
        while self._shared:
            self._compress(self._shared.pop(next(iter(self._shared))))
        for entry in self._compressed:
            entry["buffer"] = 1 + len(self._others)
        self._data.write(bytes(-self._data.tell() % ALIGNMENT if not as_text else 0))
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
                text += b" " * (-len(text) % ALIGNMENT)
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
