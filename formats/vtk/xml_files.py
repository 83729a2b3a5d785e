"""Read VTK's XML files of grids and polygonal data: ASCII, base64 or appended data, plain or compressed by zlib."""

from __future__ import annotations

import base64
import zlib
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged
from pdecodec.formats.base.frame_data import DataKey, StoredData
from pdecodec.formats.base.frame_meshes import MeshFile
from pdecodec.formats.vtk.cells import Cells, Solids
from pdecodec.formats.vtk.grid_files import TIME, GridFile, grid_of_cells, is_vectors, joined_grids
from pdecodec.mesh.fields import FieldDomain
from pdecodec.mesh.sequence import Connectivity

_CELLS = {
    **{1: "polyline", 3: "line", 4: "polyline", 5: "triangle", 7: "polygon", 9: "quad"},
    **{10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid", 21: "line", 22: "triangle", 23: "quad", 24: "tetra"},
    **{25: "hexahedron", 26: "wedge", 27: "pyramid", 28: "quad", 29: "hexahedron", 31: "wedge", 32: "wedge"},
    **{33: "hexahedron", 34: "triangle", 35: "line", 37: "pyramid"},
}
"""Kinds of cells by VTK's numbers of cell types."""

TYPES = {
    f"{name}{8 * size}": f"{letter}{size}"
    for name, letter, sizes in (("Float", "f", (4, 8)), ("Int", "i", (1, 2, 4, 8)), ("UInt", "u", (1, 2, 4, 8)))
    for size in sizes
}
"""NumPy's names of number types by VTK's names."""

GHOSTS, _HIDDEN_BITS = "vtkGhostType", 1 | 32
"""Cell data that mark cells that are left out: cells that another part has too (1), and hidden cells (32)."""

XML_DAMAGE = (ArithmeticError, AttributeError, LookupError, OSError, SyntaxError, TypeError, ValueError, zlib.error)
"""Exceptions of ElementTree, base64, zlib and NumPy on damaged or missing parts."""

_RAW_BEGIN, _RAW_END = b"<AppendedData", b"</AppendedData>"

_KINDS = ("UnstructuredGrid", "PolyData")


class XmlFile:
    """Reads one VTP or VTU file; its pieces are joined.

    Parameters
    ----------
    path : pathlib.Path
    wanted : str or None
        Name of the vectors on points to read.
    solids : {"surface", "keep"}

    Attributes
    ----------
    grid : GridFile

    Raises
    ------
    InputError
        If it uses an unsupported feature.
    ArithmeticError, AttributeError, LookupError, OSError, SyntaxError, TypeError, ValueError, zlib.error
        If it is damaged (:data:`XML_DAMAGE`).
    """

    def __init__(self, path: Path, wanted: str | None, solids: Solids = "surface") -> None:
        self._solids = solids
        text = path.read_bytes()
        self._appended, self._is_raw = b"", False
        begin = text.find(_RAW_BEGIN)
        if begin >= 0:
            # Appended data start after an underscore and need not be valid XML.
            start, end = text.index(b"_", text.index(b">", begin)) + 1, text.rindex(_RAW_END)
            self._appended, self._is_raw = text[start:end], b'encoding="raw"' in text[begin : begin + 200]
            text = text[:begin] + text[end + len(_RAW_END) :]
        root = ElementTree.fromstring(text)
        self._kind, self._wanted = str(root.get("type")), wanted
        if self._kind not in _KINDS:
            raise ValueError(f"its type is {self._kind}")
        self._order = ">" if root.get("byte_order") == "BigEndian" else "<"
        self._header = np.dtype(self._order + TYPES[root.get("header_type", "UInt32")])
        self._compressor = root.get("compressor")
        pieces = root.findall(f"./{self._kind}/Piece")
        if not pieces:
            raise ValueError("it has no Piece element")
        if any(int(piece.get("NumberOfStrips", "0")) for piece in pieces):
            raise InputError(
                "holds triangle strips; cut them into triangles first", code="unsupported-feature", path=path
            )
        fields = {str(one.get("Name")): one for one in root.findall(f"./{self._kind}/FieldData/*")}
        time = self._time(fields.pop(TIME, None))
        self.grid = replace(joined_grids([self._grid(piece) for piece in pieces]), time=time, field_data=tuple(fields))

    def _time(self, array: ElementTree.Element | None) -> float | None:
        """Return the time of the data set, which VTK stores in its field data; None if there is none."""
        values = np.zeros(0) if array is None else self._array(array)
        return float(values[0]) if values.size == 1 else None

    def _grid(self, piece: ElementTree.Element) -> GridFile:
        data, cell_data = (piece.findall(f"{kind}/DataArray") for kind in ("PointData", "CellData"))
        cell_names = [str(one.get("Name")) for one in cell_data if one.get("Name") != GHOSTS]
        array = piece.find("./Points/DataArray")
        if array is None and int(piece.get("NumberOfPoints", "1")):
            raise ValueError("there are no points")
        points = np.zeros((0, 3), np.float32) if array is None else self._array(array).reshape(-1, 3)
        arrays = {str(one.get("Name")): self._data(one) for one in data if one.get("Name") != GHOSTS}
        ghosts = next((self._array(one) for one in cell_data if one.get("Name") == GHOSTS), None)
        if self._kind == "UnstructuredGrid":
            hidden = None if ghosts is None or not (ghosts & _HIDDEN_BITS).any() else (ghosts & _HIDDEN_BITS) > 0
            cells = self._grid_cells(piece.find("Cells"), hidden)
            shown = None if hidden is None else ~hidden
            stored = self._stored(data, "vertex") | self._stored(cell_data, "face", shown)
            return grid_of_cells(points, cells, arrays, cell_names, self._wanted, stored, only_used=hidden is not None)
        if ghosts is not None and (ghosts & _HIDDEN_BITS).any():
            raise InputError(
                "holds ghost cells of polygons, which are not told apart; write it without them",
                code="unsupported-feature",
            )
        vertices, lines, faces = (self._cells(piece.find(kind)) for kind in ("Verts", "Lines", "Polys"))
        joined = (np.concatenate(both) for both in zip(vertices, lines, strict=True))
        # Cell data are stored for vertices, lines and faces, in this order.
        others = slice(len(vertices[0]) + len(lines[0]), None)
        stored = self._stored(data, "vertex") | self._stored(cell_data, "face", others)
        notices: tuple[str, ...] = ()
        if others.start and len(faces[0]) and len(stored) > len(arrays):
            notices = (f"cell data of {others.start} cells that are not faces are not kept",)
        mesh = MeshFile(points, Connectivity(len(points), *faces, *joined), (), notices, stored)
        vectors = tuple(name for name, values in arrays.items() if is_vectors(values))
        added = arrays[self._wanted] if self._wanted in vectors and self._wanted is not None else None
        return GridFile(mesh, vectors, tuple(arrays), tuple(cell_names), added)

    def _stored(
        self, arrays: list[ElementTree.Element], domain: FieldDomain, rows: Any = None
    ) -> dict[DataKey, StoredData]:
        """Return all or selected rows of data on points or cells, by name; text is left out."""
        found: dict[DataKey, StoredData] = {}
        for one in arrays:
            if one.get("Name") == GHOSTS or str(one.get("type")) not in TYPES:
                continue
            width = int(one.get("NumberOfComponents", "1")) or 1
            one_array = StoredData(np.dtype(TYPES[str(one.get("type"))]), width, partial(self._rows, one, width))
            found[domain, str(one.get("Name"))] = one_array if rows is None else one_array.gathered(rows)
        return found

    def _rows(self, array: ElementTree.Element, width: int) -> NDArray[Any]:
        try:
            return self._array(array).reshape(-1, width)
        except XML_DAMAGE as error:
            raise damaged(f"its data {array.get('Name')!r} are damaged ({error}); export it again") from error

    def _data(self, array: ElementTree.Element) -> NDArray[Any]:
        """Return point data named `wanted`; for other data an empty array of the same type and number of components."""
        width = int(array.get("NumberOfComponents", "1"))
        if str(array.get("Name")) == self._wanted:
            return self._array(array).reshape(-1, width)
        return np.zeros((0, width), TYPES.get(str(array.get("type")), "i1"))

    def _cells(self, cells: ElementTree.Element | None) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return the number of points of each cell, and the indices of all points."""
        arrays = {} if cells is None else {one.get("Name"): one for one in cells.findall("DataArray")}
        if "offsets" not in arrays:
            return np.zeros(0, np.int32), np.zeros(0, np.int32)
        ends = self._array(arrays["offsets"]).astype(np.int64)
        return np.diff(ends, prepend=0).astype(np.int32), self._array(arrays["connectivity"]).astype(np.int64)

    def _grid_cells(self, element: ElementTree.Element | None, hidden: NDArray[np.bool_] | None) -> Cells:
        """Return the cells of a grid except hidden ones; consecutive cells of one type and size form a block."""
        cells, (counts, indices) = Cells(vtk=True, solids=self._solids), self._cells(element)
        if element is None or not counts.size:
            return cells
        arrays = {one.get("Name"): one for one in element.findall("DataArray")}
        types = self._array(arrays["types"])
        if types.size != counts.size or int(counts.sum()) != indices.size:
            raise ValueError("its cells do not fit each other")
        if hidden is not None:
            if hidden.size != counts.size:
                raise ValueError("its ghost cells do not fit its cells")
            indices = indices[~np.repeat(hidden, counts)]
            types, counts = types[~hidden], counts[~hidden]
        ends = np.append(np.flatnonzero(np.diff(types) | np.diff(counts)) + 1, counts.size).tolist()
        first = used = 0
        for end in ends:
            if end == first:
                break
            rows = indices[used : used + int(counts[first]) * (end - first)].reshape(end - first, -1)
            cells.add(_CELLS[int(types[first])], rows)
            first, used = end, used + rows.size
        return cells

    def _array(self, array: ElementTree.Element) -> NDArray[Any]:
        dtype = np.dtype(self._order + TYPES[str(array.get("type"))])
        kind, text = array.get("format", "ascii"), (array.text or "")
        if kind == "ascii":
            return np.fromiter(map(float if dtype.kind == "f" else int, text.split()), dtype)
        if self._compressor not in (None, "vtkZLibDataCompressor"):
            raise ValueError(f"its compressor {self._compressor} is not supported, only vtkZLibDataCompressor")
        if kind == "binary":
            packed = "".join(text.split()).encode()
            return np.frombuffer(self._decoded(packed) if packed else b"", dtype)
        part = self._appended[int(str(array.get("offset"))) :]
        return np.frombuffer(self._unpacked(part) if self._is_raw else self._decoded(part), dtype)

    def _decoded(self, text: bytes) -> bytes:
        """Decode base64 of a header and data; if compressed, both are padded separately."""
        size = self._header.itemsize
        first = int(np.frombuffer(base64.b64decode(text[: _encoded(size)]), self._header, count=1)[0])
        if self._compressor is None:
            return base64.b64decode(text[: _encoded(size + first)])[size : size + first]
        head_length = size * (3 + first)
        start = _encoded(head_length)
        head = base64.b64decode(text[:start])[:head_length]
        packed = int(np.frombuffer(head, self._header)[3:].sum())
        return self._unpacked(head + base64.b64decode(text[start : start + _encoded(packed)]))

    def _unpacked(self, data: bytes) -> bytes:
        """Return the data after a header of lengths, decompressed."""
        size = self._header.itemsize
        first = int(np.frombuffer(data, self._header, count=1)[0])
        if self._compressor is None:
            return data[size : size + first]
        sizes = np.frombuffer(data, self._header, count=3 + first)[3:].astype(np.int64)
        ends = size * (3 + first) + np.cumsum(sizes)
        blocks = (data[end - length : end] for end, length in zip(ends.tolist(), sizes.tolist(), strict=True))
        return b"".join(map(zlib.decompress, blocks))


def _encoded(length: int) -> int:
    """Return the number of base64 characters for a number of bytes."""
    return (length + 2) // 3 * 4
