"""Write VTU files, one per frame, and PVD lists of them."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.attribute_roles import joined_colors, joining_notices, main_color
from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.frame_files import FOLDER_PADDING, frames_there
from pdecodec.formats.base.frame_writing import FrameBytes, write_frames
from pdecodec.formats.base.normals import VertexNormals
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.written_fields import WrittenFields
from pdecodec.formats.vtk.cells import is_kind, only_known_cells
from pdecodec.formats.vtk.xml_files import TYPES
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import CELL_SHAPES, Attribute, MeshObject, MeshSequence
from pdecodec.system.whole_output import check_writable

_TYPES_OF = {
    **{("polyline", 1): 1, ("line", 1): 1, ("line", 2): 3, ("line", 3): 21, ("line", 4): 35},
    **{("triangle", 3): 5, ("triangle", 6): 22, ("triangle", 7): 34, ("quad", 4): 9, ("quad", 8): 23, ("quad", 9): 28},
    **{("tetra", 4): 10, ("tetra", 10): 24, ("pyramid", 5): 14, ("pyramid", 13): 27, ("pyramid", 19): 37},
    **{("wedge", 6): 13, ("wedge", 12): 31, ("wedge", 15): 26, ("wedge", 18): 32},
    **{("hexahedron", 8): 12, ("hexahedron", 20): 25, ("hexahedron", 24): 33, ("hexahedron", 27): 29},
}
"""VTK's numbers of cell types, by shape and number of nodes."""

_TYPES_OF_ANY_SIZE = {"polyline": 4, "polygon": 7}

_OBJECT, _COLOR, _NORMALS = "object", "color", "Normals"
"""Names of point data for the numbers of objects, colours and normals."""

_NAMES = {code: name for name, code in TYPES.items()}


def write_vtu(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write VTU files (``name.####.vtu``); objects are joined to one grid."""
    grids = _Grids()
    write_frames(sequence, output, "VTU", grids.of_run)
    return tuple(grids.notices)


def write_pvd(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write VTU files, and next to them a list of the files with their times, ``name.pvd``."""
    path = output.path
    check_writable(path, overwrite=output.overwrite)
    grids = _Grids()
    frames = replace(output, path=path.with_name(f"{path.stem}.{FOLDER_PADDING}.vtu"))

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
    """Grids of runs, and the notices about what they cannot store, without repetition."""

    def __init__(self) -> None:
        self.notices: dict[str, None] = {}

    def of_run(self, run: MeshSequence, first: int) -> FrameBytes:
        grid = _Grid(run)
        self.notices.update(dict.fromkeys(grid.notices))
        return grid.of_frame


class _Grid:
    """The parts of VTU files that are the same in every frame of a run."""

    def __init__(self, sequence: MeshSequence) -> None:
        self._times = sequence.times
        self._fields = WrittenFields(sequence, ("vertex", "face", "cell"))
        whole, corners_alone = only_known_cells(self._fields.cells, "VTU", _TYPES_OF)
        kinds = np.zeros(whole.cell_count, np.uint8)
        for (shape, nodes), number in _TYPES_OF.items():
            kinds[is_kind(whole, shape, nodes)] = number
        for shape, number in _TYPES_OF_ANY_SIZE.items():
            kinds[(whole.cell_shapes == CELL_SHAPES.index(shape)) & (kinds == 0)] = number
        colors, self._normals = joined_colors(sequence.objects), VertexNormals(sequence)
        constant = {_OBJECT: len(sequence.objects) > 1, _COLOR: colors is not None, _NORMALS: self._normals.held}
        there = [name for name, is_there in constant.items() if is_there]
        own = self._fields.names("vertex")
        replaced = [name for name in there if name in own]
        point_data = b""
        if has_numbers := _OBJECT in there and _OBJECT not in replaced:
            sizes = [item.vertex_count for item in sequence.objects]
            point_data = _array(_OBJECT, np.repeat(np.arange(len(sizes), dtype=np.int32), sizes))
        written_colors = None if _COLOR in replaced else colors
        if written_colors is not None:
            point_data += _array(_COLOR, written_colors)
        self._has_normals = self._normals.held and _NORMALS not in replaced
        kind = ' Normals="Normals"' if self._has_normals else ""
        piece = f'    <Piece NumberOfPoints="{whole.vertex_count}" NumberOfCells="{whole.cell_count}">\n'
        self._pieces = (
            f"{piece}      <PointData{kind}>".encode() + point_data,
            b"</PointData>\n      <CellData>",
            b"</CellData>\n      <Points>",
            b"</Points>\n      <Cells>"
            + _array("connectivity", whole.cell_indices)
            + _array("offsets", np.cumsum(whole.cell_counts, dtype=np.int32))
            + _array("types", kinds)
            + b"</Cells>\n    </Piece>\n  </UnstructuredGrid>\n</VTKFile>\n",
        )
        numbers = f", their numbers are the point data {_OBJECT!r}" if has_numbers else ""

        def is_told_or_held(item: MeshObject, one: Attribute) -> bool:
            return self._normals.holds(item, one) or (_COLOR in replaced and one is main_color(item))

        self.notices = joining_notices(sequence, "VTU", f"grid{numbers}", written_colors, is_told_or_held)
        self.notices += not_kept(replaced, "not kept, because fields have their names: {}")
        self.notices += (*self._fields.notices(), *corners_alone)

    def of_frame(self, points: Float32Array, frame: int) -> list[bytes]:
        head = (
            b'<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
            b'header_type="UInt64">\n  <UnstructuredGrid>\n    <FieldData>'
            + _array("TimeValue", self._times[frame : frame + 1], tuples=True)
            + b"</FieldData>\n"
        )
        normals = _array(_NORMALS, self._normals.at(points)) if self._has_normals else b""
        point_data, cell_data = list[bytes](), list[bytes]()
        for one, values in self._fields.at(frame):
            (point_data if one.field.domain == "vertex" else cell_data).append(_array(one.name, values))
        before, cells, between, after = self._pieces
        points_of = _array("Points", points)
        return [head, before, normals, *point_data, cells, *cell_data, between, points_of, after]


def _array(name: str, values: NDArray[np.generic], *, tuples: bool = False) -> bytes:
    data = np.ascontiguousarray(values)
    width = f' NumberOfComponents="{data.shape[1]}"' if data.ndim == 2 else ""
    length = f' NumberOfTuples="{len(data)}"' if tuples else ""
    raw = data.astype(data.dtype.newbyteorder("<")).tobytes()
    # Length and data are encoded together: readers of uncompressed data decode them together.
    text = base64.b64encode(len(raw).to_bytes(8, "little") + raw)
    kind = _NAMES[data.dtype.str[1:]]
    return (
        f'<DataArray type="{kind}" Name={quoteattr(name)}{width}{length} format="binary">'.encode()
        + text
        + b"</DataArray>"
    )


def listed_files(path: Path) -> list[Path]:
    """Return the existing frames of a list of VTU files that would be written to a path."""
    return frames_there(path.with_name(f"{path.stem}.{FOLDER_PADDING}.vtu"))


def data_file(path: Path) -> list[Path]:
    """Return the HDF5 file that is written with an XDMF file."""
    return [path.with_suffix(".h5")]
