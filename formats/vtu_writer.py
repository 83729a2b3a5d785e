"""VTK XML unstructured grids out, one a frame, and the `.pvd` file that lists them with their times."""

from __future__ import annotations

import base64
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.attribute_roles import colors, indexed_rows, left_out
from pdecodec.formats.frame_files import FOLDER_PADDING
from pdecodec.formats.frame_writer import write_frames
from pdecodec.sequence import Attribute, Float32Array, MeshObject, MeshSequence, Progress
from pdecodec.whole_output import check_writable, whole_file

VERTEX, POLY_LINE, TRIANGLE, POLYGON, QUAD = 1, 4, 5, 7, 9
"""VTK's numbers of cell types."""

_TYPES = {"f4": "Float32", "f8": "Float64", "i4": "Int32", "u1": "UInt8"}


def write_vtu(
    sequence: MeshSequence,
    path: Path,
    *,
    overwrite: bool = False,
    fps: float | None = None,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Write a sequence as VTU files (``name.####.vtu``); objects are joined to one grid.

    Raises
    ------
    InputError
        If the place is taken or not writable, or several frames are to go to one file.
    """
    rate = sequence.fps if fps is None else fps
    grid = _Grid(sequence)
    write_frames(sequence, path, grid.of_frame, rate=rate, overwrite=overwrite, progress=progress, what="VTU")
    return grid.notices


def write_pvd(
    sequence: MeshSequence,
    path: Path,
    *,
    overwrite: bool = False,
    fps: float | None = None,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Write a sequence as VTU files beside a list of them with their times, ``name.pvd``.

    Raises
    ------
    InputError
        If the place is taken or not writable.
    """
    check_writable(path, overwrite=overwrite)
    rate = sequence.fps if fps is None else fps
    grid = _Grid(sequence)
    pattern = path.with_name(f"{path.stem}.{FOLDER_PADDING}.vtu")
    files = write_frames(
        sequence, pattern, grid.of_frame, rate=rate, overwrite=overwrite, progress=progress, what="VTU"
    )
    rows = "".join(
        f'    <DataSet timestep="{float(time)!r}" file={quoteattr(file.name)}/>\n'
        for time, file in zip(sequence.times, files, strict=True)
    )
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
    text = f"{head}{rows}  </Collection>\n</VTKFile>\n"
    with whole_file(path, overwrite=overwrite) as partial:
        partial.write_text(text, encoding="utf-8")
    return grid.notices


class _Grid:
    """What is the same in every frame."""

    def __init__(self, sequence: MeshSequence) -> None:
        whole = sequence.connectivity
        counts = np.concatenate([whole.face_counts, whole.line_counts])
        kinds = np.full(whole.face_count, POLYGON, np.uint8)
        kinds[whole.face_counts == 3] = TRIANGLE
        kinds[whole.face_counts == 4] = QUAD
        lines = np.where(whole.line_counts == 1, VERTEX, POLY_LINE).astype(np.uint8)
        kinds = np.concatenate([kinds, lines])
        indices = np.concatenate([whole.face_indices, whole.line_indices])
        numbers = np.repeat(
            np.arange(len(sequence.objects), dtype=np.int32), [item.vertex_count for item in sequence.objects]
        )
        point_data = _array("object", numbers) if len(sequence.objects) > 1 else ""
        shared = self._shared_color(sequence)
        if shared is not None:
            point_data += _array("color", shared)
        self._pieces = (
            f'    <Piece NumberOfPoints="{whole.vertex_count}" NumberOfCells="{counts.size}">\n'
            f"      <PointData>{point_data}</PointData>\n      <Points>",
            "</Points>\n      <Cells>"
            + _array("connectivity", indices)
            + _array("offsets", np.cumsum(counts, dtype=np.int32))
            + _array("types", kinds)
            + "</Cells>\n    </Piece>\n  </UnstructuredGrid>\n</VTKFile>\n",
        )
        self.notices: tuple[str, ...] = ()
        if len(sequence.objects) > 1 or sequence.objects[0].name != "mesh":
            self.notices += ("VTU has no names: objects are one grid, their numbers are the point data 'object'",)
        self.notices += left_out(sequence, "VTU", lambda item, one: shared is not None and _color_of(item) is one)

    def _shared_color(self, sequence: MeshSequence) -> NDArray[np.float32] | None:
        parts = []
        for item in sequence.objects:
            one = _color_of(item)
            if one is None:
                return None
            values, indices, _ = indexed_rows(one)
            parts.append(values if indices is None else values[indices])
        if len({part.shape[1] for part in parts}) > 1:
            return None
        return np.concatenate(parts)

    def of_frame(self, points: Float32Array, time: float) -> bytes:
        head = (
            '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
            'header_type="UInt64">\n  <UnstructuredGrid>\n    <FieldData>'
            + _array("TimeValue", np.array([time]), tuples=True)
            + "</FieldData>\n"
        )
        return (head + self._pieces[0] + _array("Points", points) + self._pieces[1]).encode("utf-8")


def _color_of(item: MeshObject) -> Attribute | None:
    return next((one for one in colors(item) if one.domain == "vertex"), None)


def _array(name: str, values: NDArray[np.generic], *, tuples: bool = False) -> str:
    data = np.ascontiguousarray(values)
    kind = _TYPES[data.dtype.str[1:]]
    width = f' NumberOfComponents="{data.shape[1]}"' if data.ndim == 2 else ""
    length = f' NumberOfTuples="{len(data)}"' if tuples else ""
    raw = data.astype(data.dtype.newbyteorder("<")).tobytes()
    # Length and data are one run of base64: readers decode them together where there is no compressor.
    text = base64.b64encode(len(raw).to_bytes(8, "little") + raw).decode("ascii")
    return f'<DataArray type="{kind}" Name="{name}"{width}{length} format="binary">{text}</DataArray>'
