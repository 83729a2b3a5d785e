"""VTK's files: VTU and the PVD lists of them in and out, VTP and legacy VTK in.

XML files (``.vtu``, ``.vtp``) are read here: data as text, as base64 or appended (base64 or raw), plain or compressed
by zlib. Other grids and legacy files (``.vtk``) are read by meshio, and what it refuses by VTK (extra ``vtk``). meshio
is guarded: its ``read`` may print, end the process, or raise whatever its parsers meet; here each is one line that
names the file.
"""

from __future__ import annotations

import base64
import contextlib
import dataclasses
import io
import math
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.formats.base.attribute_roles import joined_colors, lost_by_joining
from pdecodec.formats.base.frame_files import FOLDER_PADDING
from pdecodec.formats.base.frame_meshes import (
    FrameBytes,
    MeshFile,
    not_kept,
    open_frames,
    sequence_of_files,
    write_frames,
)
from pdecodec.formats.base.normals import VertexNormals
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.times import timing_of_stored
from pdecodec.formats.vtk.cells import Cells, left_out_notice, node_attribute
from pdecodec.formats.vtk.library import else_vtk
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import Connectivity, MeshSequence
from pdecodec.system.whole_output import check_writable

VERTEX, POLY_LINE, TRIANGLE, POLYGON, QUAD = 1, 4, 5, 7, 9
"""VTK's numbers of cell types that are written."""

_CELLS = {
    **{VERTEX: "polyline", 3: "line", POLY_LINE: "polyline", TRIANGLE: "triangle", POLYGON: "polygon", QUAD: "quad"},
    **{10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid", 21: "line", 22: "triangle", 23: "quad", 24: "tetra"},
    **{25: "hexahedron", 26: "wedge", 27: "pyramid", 28: "quad", 29: "hexahedron", 34: "triangle"},
}
"""Kinds of cells by VTK's numbers of cell types."""

_TYPES = {
    f"{name}{8 * size}": f"{letter}{size}"
    for name, letter, sizes in (("Float", "f", (4, 8)), ("Int", "i", (1, 2, 4, 8)), ("UInt", "u", (1, 2, 4, 8)))
    for size in sizes
}
_NAMES = {code: name for name, code in _TYPES.items()}

_RAW_BEGIN, _RAW_END = b"<AppendedData", b"</AppendedData>"

_DAMAGE = (ArithmeticError, AttributeError, LookupError, OSError, SyntaxError, TypeError, ValueError, zlib.error)
"""What ElementTree, base64, zlib and NumPy raise on damaged or missing parts."""

KINDS = frozenset({"line", "triangle", "quad", "polygon", "tetra", "pyramid", "wedge", "hexahedron"})
"""meshio's names of kinds of cells, without numbers of nodes."""

_UNREAD = "cells that meshio cannot handle"
"""What meshio says of cells that it leaves out."""

_MESHIO_RAISES = (SystemExit, AssertionError, EOFError, MemoryError, NameError, RuntimeError, struct.error)
"""What meshio's parsers raise beside that."""


def open_vtu(path: Path, *, fps: float | None) -> MeshSequence:
    """Open VTK's XML unstructured grids, one a frame; InputError where the first one cannot be used."""
    return open_frames(path, ".vtu", else_vtk(_read_vtu), fps)


def open_vtk(path: Path, *, fps: float | None) -> MeshSequence:
    """Open legacy VTK files, one a frame; errors as of :func:`open_vtu`."""
    return open_frames(path, ".vtk", else_vtk(read_with_meshio), fps)


def read_with_meshio(path: Path) -> MeshFile:
    """One file's mesh.

    Raises
    ------
    InputError
        If meshio cannot read it, or it holds cells that are neither faces nor lines.
    """
    import meshio

    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), np.errstate(all="ignore"):
            mesh = meshio.read(path)
            if _UNREAD in said.getvalue():
                raise ValueError
            return _mesh_file(mesh, path)
    except (meshio.ReadError, *_DAMAGE, *_MESHIO_RAISES) as error:
        reason = " ".join(f"{error} {said.getvalue()}".split())[:200] or type(error).__name__
        raise InputError(f"meshio cannot read it ({reason}); check or export it again", path=path) from error


def _mesh_file(mesh: Any, path: Path) -> MeshFile:
    points = np.zeros((len(mesh.points), 3), np.result_type(mesh.points, np.float32))
    points[:, : mesh.points.shape[1]] = mesh.points
    cells = Cells(vtk=True)
    for block in mesh.cells:
        kind = block.type.rstrip("0123456789")
        if kind == "polygon":
            for row in block.data:
                cells.add(kind, np.atleast_2d(row))
        elif kind in KINDS or kind == "vertex":
            cells.add("line" if kind == "vertex" else kind, np.asarray(block.data))
        else:
            raise InputError(f"holds cells of type {block.type}, which are not read", path=path)
    return _mesh_of_cells(points, cells, [*mesh.point_data, *mesh.cell_data])


def _mesh_of_cells(points: NDArray[np.floating], cells: Cells, names: Sequence[str]) -> MeshFile:
    """The mesh of cells at points (nodes, 3), of whose data of these names nothing is kept."""
    connectivity, gather = cells.connectivity(points)
    notices = (*not_kept(names), *left_out_notice(gather, len(points)))
    if gather is None:
        return MeshFile(points, connectivity, (), notices)
    return MeshFile(points[gather], connectivity, (node_attribute(gather),), notices)


def open_pvd(path: Path, *, fps: float | None) -> MeshSequence:
    """Open a list of VTU and VTP files; `fps` is the nominal rate. Parts of one time are joined, in their order.

    Raises
    ------
    InputError
        If it is damaged, or the first file cannot be used.
    """
    try:
        entries = ElementTree.parse(path).getroot().findall("./Collection/DataSet")
        listed = [(float(entry.get("timestep", "nan")), entry.get("file", "")) for entry in entries]
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"is no PVD file, or a damaged one ({error}); write it again", path=path) from error
    if not listed or any(not math.isfinite(time) or not file for time, file in listed):
        raise InputError("lists no files with times; write it again", path=path)
    parts: dict[float, list[Path]] = {}
    for time, file in listed:
        parts.setdefault(time, []).append(path.parent / file)
    times = sorted(parts)
    return sequence_of_files([parts[time] for time in times], timing_of_stored(np.array(times), fps), _read_part)


def _read_part(path: Path) -> MeshFile:
    return else_vtk(_read_vtp if path.suffix.lower() == ".vtp" else _read_vtu)(path)


def _read_vtu(path: Path) -> MeshFile:
    try:
        return _XmlFile(path, "UnstructuredGrid").mesh
    except (*_DAMAGE, InputError):
        return read_with_meshio(path)


def write_vtu(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write VTU files (``name.####.vtu``); objects are joined to one grid."""
    grids = _Grids()
    write_frames(sequence, output, "VTU", grids.of_run)
    return tuple(grids.notices)


def write_pvd(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write VTU files beside a list of them with their times, ``name.pvd``."""
    path = output.path
    check_writable(path, overwrite=output.overwrite)
    grids = _Grids()
    frames = dataclasses.replace(output, path=path.with_name(f"{path.stem}.{FOLDER_PADDING}.vtu"))

    def listed(files: Sequence[Path]) -> bytes:
        rows = "".join(
            f'    <DataSet timestep="{float(time)!r}" file={quoteattr(file.name)}/>\n'
            for time, file in zip(sequence.times, files, strict=True)
        )
        head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
        return f"{head}{rows}  </Collection>\n</VTKFile>\n".encode()

    write_frames(sequence, frames, "VTU", grids.of_run, index=(path, listed))
    return tuple(grids.notices)


class _Grids:
    """Grids of runs, and what they cannot hold, each line once."""

    def __init__(self) -> None:
        self.notices: dict[str, None] = {}

    def of_run(self, run: MeshSequence, first: int) -> FrameBytes:
        grid = _Grid(run)
        self.notices.update(dict.fromkeys(grid.notices))
        return grid.of_frame


class _Grid:
    """What is the same in every frame of a run of VTU files."""

    def __init__(self, sequence: MeshSequence) -> None:
        whole = sequence.connectivity
        self._times = sequence.times
        counts = np.concatenate([whole.face_counts, whole.line_counts])
        faces = np.select([whole.face_counts == 3, whole.face_counts == 4], [TRIANGLE, QUAD], POLYGON)
        kinds = np.concatenate([faces, np.where(whole.line_counts == 1, VERTEX, POLY_LINE)]).astype(np.uint8)
        point_data = ""
        if len(sequence.objects) > 1:
            sizes = [item.vertex_count for item in sequence.objects]
            point_data = _array("object", np.repeat(np.arange(len(sizes), dtype=np.int32), sizes))
        colors = joined_colors(sequence)
        if colors is not None:
            point_data += _array("color", colors)
        self._normals = VertexNormals(sequence)
        kind = ' Normals="Normals"' if self._normals.held else ""
        self._pieces = (
            f'    <Piece NumberOfPoints="{whole.vertex_count}" NumberOfCells="{counts.size}">\n'
            f"      <PointData{kind}>{point_data}",
            "</PointData>\n      <Points>",
            "</Points>\n      <Cells>"
            + _array("connectivity", np.concatenate([whole.face_indices, whole.line_indices]))
            + _array("offsets", np.cumsum(counts, dtype=np.int32))
            + _array("types", kinds)
            + "</Cells>\n    </Piece>\n  </UnstructuredGrid>\n</VTKFile>\n",
        )
        self.notices = lost_by_joining(
            sequence, "VTU", "grid, their numbers are the point data 'object'", colors, self._normals.holds
        )

    def of_frame(self, points: Float32Array, frame: int) -> bytes:
        head = (
            '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
            'header_type="UInt64">\n  <UnstructuredGrid>\n    <FieldData>'
            + _array("TimeValue", self._times[frame : frame + 1], tuples=True)
            + "</FieldData>\n"
        )
        normals = _array("Normals", self._normals.at(points)) if self._normals.held else ""
        before, between, after = self._pieces
        return (head + before + normals + between + _array("Points", points) + after).encode("utf-8")


def _array(name: str, values: NDArray[np.generic], *, tuples: bool = False) -> str:
    data = np.ascontiguousarray(values)
    width = f' NumberOfComponents="{data.shape[1]}"' if data.ndim == 2 else ""
    length = f' NumberOfTuples="{len(data)}"' if tuples else ""
    raw = data.astype(data.dtype.newbyteorder("<")).tobytes()
    # Length and data are one run of base64: readers decode them together where there is no compressor.
    text = base64.b64encode(len(raw).to_bytes(8, "little") + raw).decode("ascii")
    kind = _NAMES[data.dtype.str[1:]]
    return f'<DataArray type="{kind}" Name="{name}"{width}{length} format="binary">{text}</DataArray>'


def open_vtp(path: Path, *, fps: float | None) -> MeshSequence:
    """Open VTP files, one a frame; InputError where frames are missing or the first one cannot be used."""
    return open_frames(path, ".vtp", else_vtk(_read_vtp), fps)


def _read_vtp(path: Path) -> MeshFile:
    try:
        return _XmlFile(path, "PolyData").mesh
    except _DAMAGE as error:
        raise InputError(f"is no VTP file, or a damaged one ({error}); export it again", path=path) from error


class _XmlFile:
    """One VTP or VTU file, read."""

    def __init__(self, path: Path, kind: str) -> None:
        text = path.read_bytes()
        self._appended, self._is_raw = b"", False
        begin = text.find(_RAW_BEGIN)
        if begin >= 0:
            # Appended data start after an underscore, and need not be XML.
            start, end = text.index(b"_", text.index(b">", begin)) + 1, text.rindex(_RAW_END)
            self._appended, self._is_raw = text[start:end], b'encoding="raw"' in text[begin : begin + 200]
            text = text[:begin] + text[end + len(_RAW_END) :]
        root = ElementTree.fromstring(text)
        if root.get("type") != kind:
            raise ValueError(f"its type is {root.get('type')}")
        self._kind = kind
        self._order = ">" if root.get("byte_order") == "BigEndian" else "<"
        self._header = np.dtype(self._order + _TYPES[root.get("header_type", "UInt32")])
        self._compressed = root.get("compressor") is not None
        pieces = root.findall(f"./{kind}/Piece")
        if len(pieces) != 1:
            raise InputError(f"holds {len(pieces)} pieces; join them to one first", path=path)
        if int(pieces[0].get("NumberOfStrips", "0")):
            raise InputError("holds triangle strips; cut them into triangles first", path=path)
        self.mesh = self._mesh(pieces[0])

    def _mesh(self, piece: ElementTree.Element) -> MeshFile:
        array = piece.find("./Points/DataArray")
        if array is None:
            raise ValueError("there are no points")
        points = self._array(array).reshape(-1, 3)
        names = [
            str(one.get("Name")) for kind in ("PointData", "CellData") for one in piece.findall(f"{kind}/DataArray")
        ]
        if self._kind == "UnstructuredGrid":
            return _mesh_of_cells(points, self._grid_cells(piece.find("Cells")), names)
        vertices, lines, faces = (self._cells(piece.find(kind)) for kind in ("Verts", "Lines", "Polys"))
        joined = (np.concatenate(both) for both in zip(vertices, lines, strict=True))
        return MeshFile(points, Connectivity(len(points), *faces, *joined), (), not_kept(names))

    def _cells(self, cells: ElementTree.Element | None) -> tuple[NDArray[Any], NDArray[Any]]:
        """Counts and indices."""
        arrays = {} if cells is None else {one.get("Name"): one for one in cells.findall("DataArray")}
        if "offsets" not in arrays:
            return np.zeros(0, np.int32), np.zeros(0, np.int32)
        ends = self._array(arrays["offsets"]).astype(np.int64)
        return np.diff(ends, prepend=0).astype(np.int32), self._array(arrays["connectivity"]).astype(np.int64)

    def _grid_cells(self, element: ElementTree.Element | None) -> Cells:
        """The cells of a grid, those that follow each other and are alike as one block."""
        cells, (counts, indices) = Cells(vtk=True), self._cells(element)
        if element is None or not counts.size:
            return cells
        types = self._array(next(one for one in element.findall("DataArray") if one.get("Name") == "types"))
        if types.size != counts.size or int(counts.sum()) != indices.size:
            raise ValueError("its cells do not fit each other")
        ends = np.append(np.flatnonzero(np.diff(types) | np.diff(counts)) + 1, counts.size).tolist()
        first = used = 0
        for end in ends:
            rows = indices[used : used + int(counts[first]) * (end - first)].reshape(end - first, -1)
            cells.add(_CELLS[int(types[first])], rows)
            first, used = end, used + rows.size
        return cells

    def _array(self, array: ElementTree.Element) -> NDArray[Any]:
        dtype = np.dtype(self._order + _TYPES[str(array.get("type"))])
        kind = array.get("format", "ascii")
        if kind == "ascii":
            return np.array((array.text or "").split()).astype(dtype)
        if kind == "binary":
            return np.frombuffer(self._decoded("".join((array.text or "").split()).encode()), dtype)
        part = self._appended[int(str(array.get("offset"))) :]
        return np.frombuffer(self._unpacked(part) if self._is_raw else self._decoded(part), dtype)

    def _decoded(self, text: bytes) -> bytes:
        """Bytes of base64 that holds a header, and behind it data; compressed, each has padding of its own."""
        size = self._header.itemsize
        first = int(np.frombuffer(base64.b64decode(text[: _encoded(size)]), self._header, count=1)[0])
        if not self._compressed:
            return base64.b64decode(text[: _encoded(size + first)])[size : size + first]
        head_length = size * (3 + first)
        start = _encoded(head_length)
        head = base64.b64decode(text[:start])[:head_length]
        packed = int(np.frombuffer(head, self._header)[3:].sum())
        return self._unpacked(head + base64.b64decode(text[start : start + _encoded(packed)]))

    def _unpacked(self, data: bytes) -> bytes:
        """Bytes behind a header of lengths."""
        size = self._header.itemsize
        first = int(np.frombuffer(data, self._header, count=1)[0])
        if not self._compressed:
            return data[size : size + first]
        sizes = np.frombuffer(data, self._header, count=3 + first)[3:].astype(np.int64)
        ends = size * (3 + first) + np.cumsum(sizes)
        blocks = (data[end - length : end] for end, length in zip(ends.tolist(), sizes.tolist(), strict=True))
        return b"".join(map(zlib.decompress, blocks))


def _encoded(length: int) -> int:
    """Letters of base64 that so many bytes take."""
    return (length + 2) // 3 * 4
