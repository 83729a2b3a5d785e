"""VTK's XML polygonal data, which meshio does not read: points, vertices, lines and polygons of one file a frame.

Data may stand as text, as base64, or appended (base64 or raw), and be compressed by zlib.
"""

from __future__ import annotations

import base64
import binascii
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.formats.frame_sequence import MeshFile, open_frames
from pdecodec.sequence import Connectivity, MeshSequence

_TYPES = {
    "Float32": "f4",
    "Float64": "f8",
    "Int8": "i1",
    "UInt8": "u1",
    "Int16": "i2",
    "UInt16": "u2",
    "Int32": "i4",
    "UInt32": "u4",
    "Int64": "i8",
    "UInt64": "u8",
}

_RAW_BEGIN, _RAW_END = b"<AppendedData", b"</AppendedData>"

_DAMAGE = (
    ElementTree.ParseError,
    OSError,
    KeyError,
    ValueError,
    IndexError,
    TypeError,
    AttributeError,
    OverflowError,
    binascii.Error,
    zlib.error,
)


def open_vtp(path: Path, *, fps: float | None) -> MeshSequence:
    """Open VTP files, one a frame.

    Raises
    ------
    InputError
        If frames are missing, or the first one cannot be used.
    """
    return open_frames(path, ".vtp", read_vtp, fps)


def read_vtp(path: Path) -> MeshFile:
    """One file's mesh.

    Raises
    ------
    InputError
        If it is damaged, or holds triangle strips.
    """
    try:
        return _Reader(path.read_bytes(), path).read()
    except _DAMAGE as error:
        raise InputError(f"is no VTP file, or a damaged one ({error}); export it again", path=path) from error


@dataclass
class _Reader:
    data: bytes
    path: Path

    def read(self) -> MeshFile:
        text, self._appended = self._split_appended()
        self._root = ElementTree.fromstring(text)
        if self._root.get("type") != "PolyData":
            raise ValueError(f"its type is {self._root.get('type')}")
        self._order = ">" if self._root.get("byte_order") == "BigEndian" else "<"
        self._header = np.dtype(self._order + _TYPES[self._root.get("header_type", "UInt32")])
        self._compressed = self._root.get("compressor") is not None
        pieces = self._root.findall("./PolyData/Piece")
        if len(pieces) != 1:
            raise InputError(f"holds {len(pieces)} pieces; join them to one first", path=self.path)
        if int(pieces[0].get("NumberOfStrips", "0")):
            raise InputError("holds triangle strips; cut them into triangles first", path=self.path)
        array = pieces[0].find("./Points/DataArray")
        if array is None:
            raise ValueError("there are no points")
        points = self._array(array).reshape(-1, 3).astype(np.float32)
        vertex_counts, vertices = self._cells(pieces[0].find("Verts"))
        line_counts, lines = self._cells(pieces[0].find("Lines"))
        face_counts, faces = self._cells(pieces[0].find("Polys"))
        connectivity = Connectivity(
            len(points),
            face_counts,
            faces,
            np.concatenate([vertex_counts, line_counts]),
            np.concatenate([vertices, lines]),
        )
        names = [
            str(one.get("Name")) for kind in ("PointData", "CellData") for one in pieces[0].findall(f"{kind}/DataArray")
        ]
        return MeshFile(points, connectivity, (), (f"not kept: {', '.join(names)}",) if names else ())

    def _cells(self, cells: ElementTree.Element | None) -> tuple[NDArray[Any], NDArray[Any]]:
        """Counts and indices."""
        arrays = {} if cells is None else {one.get("Name"): one for one in cells.findall("DataArray")}
        if "offsets" not in arrays:
            return np.zeros(0, np.int32), np.zeros(0, np.int32)
        ends = self._array(arrays["offsets"]).astype(np.int64)
        indices = self._array(arrays["connectivity"]).astype(np.int64)
        return np.diff(ends, prepend=0).astype(np.int32), indices

    def _split_appended(self) -> tuple[bytes, bytes]:
        """The XML without its appended data, and that data from after its underscore."""
        begin = self.data.find(_RAW_BEGIN)
        if begin < 0:
            return self.data, b""
        start = self.data.index(b"_", self.data.index(b">", begin)) + 1
        end = self.data.rindex(_RAW_END)
        return self.data[:begin] + self.data[end + len(_RAW_END) :], self.data[start:end]

    def _array(self, array: ElementTree.Element) -> NDArray[Any]:
        dtype = np.dtype(self._order + _TYPES[str(array.get("type"))])
        kind = array.get("format", "ascii")
        if kind == "ascii":
            return np.array((array.text or "").split()).astype(dtype)
        if kind == "binary":
            return np.frombuffer(self._decoded("".join((array.text or "").split()).encode()), dtype)
        offset = int(str(array.get("offset")))
        raw = b'encoding="raw"' in self.data[self.data.find(_RAW_BEGIN) :][:200]
        part = self._appended[offset:]
        return np.frombuffer(self._unpacked(part) if raw else self._decoded(part), dtype)

    def _decoded(self, text: bytes) -> bytes:
        """Bytes of base64 that holds a header, and behind it data; compressed, each has padding of its own."""
        size = self._header.itemsize
        if not self._compressed:
            length = int(np.frombuffer(base64.b64decode(text[: _encoded(size)]), self._header, count=1)[0])
            return base64.b64decode(text[: _encoded(size + length)])[size : size + length]
        blocks = int(np.frombuffer(base64.b64decode(text[: _encoded(size)])[:size], self._header)[0])
        head_length = size * (3 + blocks)
        head = base64.b64decode(text[: _encoded(head_length)])[:head_length]
        packed = int(np.frombuffer(head, self._header)[3:].sum())
        start = _encoded(head_length)
        return self._unpacked(head + base64.b64decode(text[start : start + _encoded(packed)]))

    def _unpacked(self, data: bytes) -> bytes:
        """Bytes behind a header of lengths."""
        size = self._header.itemsize
        first = int(np.frombuffer(data, self._header, count=1)[0])
        if not self._compressed:
            return data[size : size + first]
        sizes = np.frombuffer(data, self._header, count=3 + first)[3:].astype(np.int64)
        at = size * (3 + first)
        parts = []
        for length in sizes.tolist():
            parts.append(zlib.decompress(data[at : at + length]))
            at += length
        return b"".join(parts)


def _encoded(length: int) -> int:
    """Letters of base64 that so many bytes take."""
    return (length + 2) // 3 * 4
