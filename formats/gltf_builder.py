"""A glTF file that is being put together: accessors one after the other in one buffer, and the JSON around them."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.formats.gltf_file import CHUNK_HEADER, COMPONENTS, GLB_HEADER, GLB_MAGIC, WIDTHS

VERTEX_DATA, INDEX_DATA = 34962, 34963
"""Targets of buffer views: what of a mesh they hold."""

_ALIGNMENT = 4
"""Bytes that parts of a file begin at multiples of."""


class GltfBuilder:
    """Collects nodes, meshes and numbers."""

    def __init__(self) -> None:
        self.root: dict[str, Any] = {"asset": {"version": "2.0", "generator": "pdecodec"}}
        self._data = bytearray()

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Put an entry at the end of a list of the root; its index."""
        entries = self.root.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def view(self, data: NDArray[Any], target: int | None = None) -> int:
        """A buffer view of an array; its index."""
        self._data += bytes(-len(self._data) % _ALIGNMENT)
        entry: dict[str, Any] = {"buffer": 0, "byteOffset": len(self._data), "byteLength": data.nbytes}
        if target is not None:
            entry["target"] = target
        self._data += data.tobytes()
        return self.add("bufferViews", entry)

    def floats(self, values: ArrayLike, *, target: int | None = None, bounds: bool = False) -> int:
        """An accessor of float32 rows, with their bounds where they are asked for; its index."""
        rows = np.ascontiguousarray(values, "<f4")
        width = rows.shape[1] if rows.ndim == 2 else 1
        entry: dict[str, Any] = {
            "bufferView": self.view(rows, target),
            "componentType": _component("<f4"),
            "count": len(rows),
            "type": _type(width),
        }
        if bounds:
            table = rows.reshape(len(rows), width)
            entry["min"], entry["max"] = table.min(axis=0).tolist(), table.max(axis=0).tolist()
        return self.add("accessors", entry)

    def integers(self, values: ArrayLike, *, target: int | None = None) -> int:
        """An accessor of unsigned 32-bit numbers; its index."""
        numbers = np.ascontiguousarray(values, "<u4")
        entry = {
            "bufferView": self.view(numbers, target),
            "componentType": _component("<u4"),
            "count": numbers.size,
            "type": "SCALAR",
        }
        return self.add("accessors", entry)

    def unit_rows(self, frames: int) -> int:
        """An accessor of ``frames x (frames - 1)`` numbers: row k has a one at k - 1; its index."""
        places = np.arange(1, frames) * (frames - 1) + np.arange(frames - 1)
        entry = {
            "componentType": _component("<f4"),
            "count": frames * (frames - 1),
            "type": "SCALAR",
            "sparse": {
                "count": frames - 1,
                "indices": {"bufferView": self.view(places.astype("<u4")), "componentType": _component("<u4")},
                "values": {"bufferView": self.view(np.ones(frames - 1, "<f4"))},
            },
        }
        return self.add("accessors", entry)

    def to_glb(self) -> bytes:
        """The file as one binary."""
        self._data += bytes(-len(self._data) % _ALIGNMENT)
        self.root["buffers"] = [{"byteLength": len(self._data)}]
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

    def to_gltf(self) -> bytes:
        """The file as JSON, the numbers in it as text."""
        uri = "data:application/octet-stream;base64," + base64.b64encode(self._data).decode("ascii")
        self.root["buffers"] = [{"byteLength": len(self._data), "uri": uri}]
        return self._json()

    def _json(self) -> bytes:
        return json.dumps(self.root, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()


def _component(dtype: str) -> int:
    return next(number for number, name in COMPONENTS.items() if name == dtype)


def _type(width: int) -> str:
    return next(name for name, numbers in WIDTHS.items() if numbers == width)
