"""XDMF: a small XML file that says what is in an HDF5 file beside it; a grid for every time.

Read: temporal collections of uniform grids whose geometry, and topology, lie in HDF5 or stand in the XML; geometry of
each time, or one geometry and a vector ``displacement``. Topologies of triangles, quadrilaterals, polygons of one
size, lines, points, solids (their surface), and mixed ones. Written: one topology, a dataset of positions for every
frame.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax.saxutils import escape

import h5py
import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.formats.arrays.hdf5 import new_hdf5
from pdecodec.formats.base.attribute_roles import lost_by_joining
from pdecodec.formats.base.frame_meshes import not_kept
from pdecodec.formats.base.normals import VertexNormals
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.times import rate_or_default, timing_of_stored
from pdecodec.formats.vtk.cells import Cells, left_out_notice, node_attribute
from pdecodec.mesh.arrays import Float32Array, Int32Array, Int64Array
from pdecodec.mesh.rounding import to_float32
from pdecodec.mesh.sequence import Connectivity, MeshObject, MeshSequence, check_frame_range, check_times
from pdecodec.system.whole_output import check_writable, partial_folder, publish, write_errors

_KINDS = {
    "triangle": ("triangle", 3),
    "quadrilateral": ("quad", 4),
    "tetrahedron": ("tetra", 4),
    "pyramid": ("pyramid", 5),
    "wedge": ("wedge", 6),
    "hexahedron": ("hexahedron", 8),
    "edge_3": ("line", 3),
    "triangle_6": ("triangle", 6),
    "tri_6": ("triangle", 6),
    "quadrilateral_8": ("quad", 8),
    "quad_8": ("quad", 8),
    "quadrilateral_9": ("quad", 9),
    "quad_9": ("quad", 9),
    "tetrahedron_10": ("tetra", 10),
    "tet_10": ("tetra", 10),
    "pyramid_13": ("pyramid", 13),
    "wedge_15": ("wedge", 15),
    "wedge_18": ("wedge", 18),
    "hexahedron_20": ("hexahedron", 20),
    "hex_20": ("hexahedron", 20),
    "hexahedron_24": ("hexahedron", 24),
    "hex_24": ("hexahedron", 24),
    "hexahedron_27": ("hexahedron", 27),
    "hex_27": ("hexahedron", 27),
}
"""Kind and nodes of each cell of a topology, by its name."""

_MIXED_KINDS = {
    4: ("triangle", 3),
    5: ("quad", 4),
    6: ("tetra", 4),
    7: ("pyramid", 5),
    8: ("wedge", 6),
    9: ("hexahedron", 8),
    34: ("line", 3),
    35: ("quad", 9),
    36: ("triangle", 6),
    37: ("quad", 8),
    38: ("tetra", 10),
    39: ("pyramid", 13),
    40: ("wedge", 15),
    41: ("wedge", 18),
    48: ("hexahedron", 20),
    49: ("hexahedron", 24),
    50: ("hexahedron", 27),
}
"""Kind and nodes of cells of a mixed topology, by the number before them."""

_MIXED_SOLIDS = frozenset({6, 7, 8, 9, *range(38, 51)})
"""Those of them that are solids: added together, for there may be many."""

_MIXED_COUNTED = {1: "polyline", 2: "polyline", 3: "polygon"}
"""Points, lines and polygons of a mixed topology, which their number of nodes follows."""

DISPLACEMENTS = ("displacement", "displacements", "disp", "u")
"""Names of vectors that are added to a geometry that stays."""

_DAMAGE = (OSError, KeyError, ValueError, TypeError, IndexError, RuntimeError, AttributeError)
"""What ElementTree, h5py and NumPy raise on damaged or missing parts."""


class XdmfSequence(MeshSequence):
    """Grids of an XDMF file; its HDF5 files stay open until :meth:`close`.

    `fps` is the nominal rate where grids have times; else frames are counted at it.

    Raises
    ------
    InputError
        If it is damaged, uses what is not read, or its connectivity changes.
    """

    def __init__(self, path: Path, *, fps: float | None) -> None:
        self._path = path
        self._files: dict[str, Any] = {}
        try:
            root = ElementTree.parse(path).getroot()
        except (ElementTree.ParseError, OSError) as error:
            raise InputError(f"is no XDMF file, or a damaged one ({error}); write it again", path=path) from error
        self._grids = _grids(root)
        if not self._grids:
            raise InputError("holds no grid; write it again", path=path)
        try:
            self._open(root, fps)
        except _DAMAGE as error:
            self.close()
            raise InputError(f"is damaged, or its HDF5 file is missing ({error})", path=path) from error
        except InputError:
            self.close()
            raise

    def _open(self, root: ElementTree.Element, fps: float | None) -> None:
        stored = [self._time(grid) for grid in self._grids]
        times = np.array([time for time in stored if time is not None], np.float64)
        if times.size == len(self._grids):
            self.times, self.fps, notices = timing_of_stored(times, fps)
        else:
            rate, notices = rate_or_default(None, fps)
            self.times, self.fps = check_times(len(self._grids), None, rate)
        # Time steps may refer to a grid beside their collection (xi:include); there is one, then.
        self._shared, self._shared_geometry = root.find(".//Topology"), root.find(".//Geometry")
        first = self._points(0)
        connectivity, self._gather = self._cells(self._grids[0], first)
        self._topology, self._nodes = self._source(self._grids[0].find("Topology")), len(first)
        attributes = () if self._gather is None else (node_attribute(self._gather),)
        self.objects = (MeshObject("mesh", connectivity, attributes),)
        self.metadata = {}
        names = (str(one.get("Name")) for one in self._grids[0].findall("Attribute") if one is not self._moving(0))
        self.notices = (*notices, *not_kept(names), *left_out_notice(self._gather, len(first)))

    def _time(self, grid: ElementTree.Element) -> float | None:
        time = grid.find("Time")
        return None if time is None or time.get("Value") is None else float(str(time.get("Value")))

    def _source(self, topology: ElementTree.Element | None) -> str:
        """Where a topology's indices are: those of one place are the same."""
        item = None if topology is None else topology.find("DataItem")
        return "" if item is None else (item.text or "").strip()

    def _moving(self, frame: int) -> ElementTree.Element | None:
        """The vectors that a frame's geometry is moved by, where all frames share one geometry."""
        named = ((str(one.get("Name")).lower(), one) for one in self._grids[frame].findall("Attribute"))
        return next((one for name, one in named if name in DISPLACEMENTS), None)

    def _points(self, frame: int) -> NDArray[np.floating]:
        geometry = self._grids[frame].find("Geometry")
        if geometry is None:
            geometry = self._shared_geometry
        if geometry is None:
            raise InputError("a grid has no geometry", path=self._path, frame=frame)
        kind = str(geometry.get("GeometryType", geometry.get("Type", "XYZ"))).upper()
        if kind not in ("XYZ", "XY"):
            raise InputError(f"geometry of type {kind} is not read; write XYZ", path=self._path, frame=frame)
        stored = self._numbers(geometry.find("DataItem")).reshape(-1, len(kind))
        points = np.zeros((len(stored), 3), np.result_type(stored, np.float32))
        points[:, : len(kind)] = stored
        moving = self._moving(frame)
        if moving is not None:
            points = points + self._numbers(moving.find("DataItem")).reshape(points.shape)
        return points

    def _numbers(self, item: ElementTree.Element | None) -> NDArray[Any]:
        if item is None:
            raise ValueError("a DataItem is missing")
        text = (item.text or "").strip()
        if item.get("Format", "XML").upper() == "XML":
            return np.array(text.split(), np.float64)
        if item.get("Format", "").upper() != "HDF":
            raise InputError(f"data of format {item.get('Format')} is not read; write HDF", path=self._path)
        name, _, place = text.partition(":")
        if name not in self._files:
            self._files[name] = h5py.File(self._path.parent / name, "r")
        return np.asarray(self._files[name][place])

    def _cells(self, grid: ElementTree.Element, points: Float32Array) -> tuple[Connectivity, Int64Array | None]:
        """Faces and lines of a grid with points (nodes, 3), and which of these are vertices: None where all are."""
        topology, cells = grid.find("Topology"), Cells()
        if topology is None:
            topology = self._shared
        if topology is None:
            return cells.connectivity(points)
        kind = str(topology.get("TopologyType", topology.get("Type", ""))).lower()
        if kind == "polyvertex" and topology.find("DataItem") is None:
            return cells.connectivity(points)
        indices: NDArray[Any] = self._numbers(topology.find("DataItem")).astype(np.int64).reshape(-1)
        size = int(topology.get("NodesPerElement", "0"))
        if kind == "mixed":
            _add_mixed(cells, indices, self._path)
        elif kind in _KINDS:
            cells.add(_KINDS[kind][0], indices.reshape(-1, _KINDS[kind][1]))
        elif kind == "polygon" and size >= 3:
            cells.add(kind, indices.reshape(-1, size))
        elif kind in ("polyline", "polyvertex"):
            cells.add("polyline", indices.reshape(-1, size or 1))
        else:
            raise InputError(f"topology of type {kind} is not read; extract the surface as polygons", path=self._path)
        return cells.connectivity(points)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        found = np.empty((stop - start, self.vertex_count, 3), np.float32)
        for frame in range(start, stop):
            try:
                points = self._points(frame)
                same = self._source(self._grids[frame].find("Topology")) in ("", self._topology)
                if len(points) != self._nodes or not (
                    same or self._cells(self._grids[frame], points)[0].same_as(self.connectivity)
                ):
                    message = "its connectivity is another; every frame must have that of the first"
                    raise InputError(message, path=self._path, frame=frame)
            except _DAMAGE as error:
                raise InputError(f"this frame cannot be read ({error})", path=self._path, frame=frame) from error
            found[frame - start] = to_float32(points if self._gather is None else points[self._gather])
        return found

    def close(self) -> None:
        for file in self._files.values():
            file.close()
        self._files = {}


def _grids(root: ElementTree.Element) -> list[ElementTree.Element]:
    """Uniform grids of the temporal collection, or the one that there is."""
    for grid in root.iter("Grid"):
        if grid.get("GridType") == "Collection" and grid.get("CollectionType") == "Temporal":
            return grid.findall("Grid")
    return [grid for grid in root.iter("Grid") if grid.get("GridType", "Uniform") == "Uniform"][:1]


def _add_mixed(cells: Cells, numbers: Int64Array, path: Path) -> None:
    """Add the cells of a mixed topology: each a number for its kind, for some their number of nodes, and nodes."""
    at = 0
    solids: dict[str, list[Int64Array]] = {}
    while at < numbers.size:
        number = int(numbers[at])
        if number in _MIXED_KINDS:
            (kind, size), at = _MIXED_KINDS[number], at + 1
        elif number in _MIXED_COUNTED and at + 1 < numbers.size:
            kind, size, at = _MIXED_COUNTED[number], int(numbers[at + 1]), at + 2
        else:
            raise InputError(f"cells of number {number} in a mixed topology are not read", path=path)
        if size < 1 or at + size > numbers.size:
            raise InputError("its mixed topology ends inside a cell", path=path)
        if number in _MIXED_SOLIDS:
            solids.setdefault(f"{kind}{size}", []).append(numbers[at : at + size])
        else:
            cells.add(kind, numbers[None, at : at + size])
        at += size
    for name, rows in solids.items():
        cells.add(name.rstrip("0123456789"), np.stack(rows))


def write_xdmf(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write ``name.xdmf`` and ``name.h5`` beside it; objects are joined to one grid."""
    path = output.path
    data_path = path.with_suffix(".h5")
    for one in (path, data_path):
        check_writable(one, overwrite=output.overwrite)
    with partial_folder(path) as folder, write_errors(path):
        with new_hdf5(folder / data_path.name) as (file, check):
            topology = _write_topology(file, sequence.connectivity, data_path.name)
            rows, normals = [], VertexNormals(sequence)
            for start, block in output.blocks(sequence, "XDMF"):
                for frame, points in enumerate(block, start):
                    name = f"points/{frame:06d}"
                    check()
                    file.create_dataset(name, data=np.ascontiguousarray(points, "<f4"), track_times=False)
                    shading = f"normals/{frame:06d}" if normals.held else None
                    if shading is not None:
                        file.create_dataset(shading, data=normals.at(points).astype("<f4"), track_times=False)
                    time = float(sequence.times[frame])
                    rows.append(_grid_text(topology, name, shading, data_path.name, len(points), time))
        (folder / path.name).write_text(_HEAD + "".join(rows) + _TAIL, encoding="utf-8")
        publish(folder, [data_path.name, path.name], overwrite=output.overwrite)
    return lost_by_joining(sequence, "XDMF", "grid", held=normals.holds)


_HEAD = (
    '<?xml version="1.0"?>\n<Xdmf Version="3.0">\n  <Domain>\n'
    '    <Grid Name="sequence" GridType="Collection" CollectionType="Temporal">\n'
)
_TAIL = "    </Grid>\n  </Domain>\n</Xdmf>\n"


def _write_topology(file: Any, whole: Connectivity, data_name: str) -> str:
    """The topology's dataset, and the XML that says so; one kind of face plainly, anything else mixed."""
    sizes = set(whole.face_counts.tolist())
    if not whole.face_count and not whole.line_count:
        return f'        <Topology TopologyType="Polyvertex" NumberOfElements="{whole.vertex_count}"/>\n'
    if not whole.line_count and len(sizes) == 1 and sizes <= {3, 4}:
        kind = "Triangle" if sizes == {3} else "Quadrilateral"
        numbers, count = whole.face_indices.reshape(whole.face_count, -1), whole.face_count
    else:
        kind, count = "Mixed", whole.face_count + whole.line_count
        cells: list[Int32Array] = []
        for counts, indices, line in (
            (whole.face_counts, whole.face_indices, False),
            (whole.line_counts, whole.line_indices, True),
        ):
            ends = np.cumsum(counts, dtype=np.int64)
            for size, end in zip(counts.tolist(), ends.tolist(), strict=True):
                number = (1 if size == 1 else 2) if line else {3: 4, 4: 5}.get(size, 3)
                head = [number] if number in _MIXED_KINDS else [number, size]
                cells += [np.array(head, np.int32), indices[end - size : end]]
        numbers = np.concatenate(cells)
    file.create_dataset("topology", data=np.ascontiguousarray(numbers, "<i4"), track_times=False)
    shape = " ".join(map(str, numbers.shape))
    return (
        f'        <Topology TopologyType="{kind}" NumberOfElements="{count}">\n'
        f'          <DataItem Dimensions="{shape}" NumberType="Int" Precision="4" Format="HDF">'
        f"{escape(data_name)}:/topology</DataItem>\n        </Topology>\n"
    )


def _grid_text(topology: str, name: str, normals: str | None, data_name: str, points: int, time: float) -> str:
    def vectors(dataset: str) -> str:
        return (
            f'          <DataItem Dimensions="{points} 3" NumberType="Float" Precision="4" Format="HDF">'
            f"{escape(data_name)}:/{dataset}</DataItem>\n"
        )

    shading = ""
    if normals is not None:
        head = '        <Attribute Name="Normals" AttributeType="Vector" Center="Node">\n'
        shading = f"{head}{vectors(normals)}        </Attribute>\n"
    return (
        f'      <Grid Name="mesh" GridType="Uniform">\n        <Time Value="{time!r}"/>\n{topology}'
        f'        <Geometry GeometryType="XYZ">\n{vectors(name)}        </Geometry>\n{shading}      </Grid>\n'
    )
