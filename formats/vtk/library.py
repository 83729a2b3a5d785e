"""Read files with the VTK library (extra ``vtk``) that meshio and our own XML reader do not support.

It reads any XML or legacy data set with points: unstructured grids, polygonal data, structured grids; solids become
their surface, with the numbers of its points. VTK runs in a worker process, since damaged files may crash it.
"""

from __future__ import annotations

import atexit
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged
from pdecodec.formats.base.frame_meshes import MeshFile, strip_triangles
from pdecodec.formats.base.isolated import call_about_file
from pdecodec.formats.vtk.cells import left_out_notice, node_attribute
from pdecodec.formats.vtk.grid_files import TIME, GridFile, Read, gather_rows, is_vectors
from pdecodec.mesh.arrays import Int64Array
from pdecodec.mesh.sequence import Attribute, Connectivity
from pdecodec.system.reading import open_regular, read_regular
from pdecodec.system.workers import Worker

ORIGINAL_POINT_IDS = "vtkOriginalPointIds"
"""Point data in which the surface filter records the original point numbers."""

PACKAGE = "vtkmodules"

BASE_MEMORY, MEMORY_FACTOR = 2**32, 256
"""Memory that VTK may use [bytes], and how much more per byte of the file: LZ4 packs up to 255 bytes into one."""

FIRST_IRREGULAR_CELL_TYPE = 42
"""VTK's lowest number of cell types that depend on more than their points: polyhedra, and cells of any order."""

_NAMES = ("vectors", "point_data", "cell_data", "field_data")
"""Attributes of a grid that are names of data."""

_SELF_CONTAINED_TYPES = ("UnstructuredGrid", "PolyData", "StructuredGrid", "RectilinearGrid", "ImageData")
"""Types of VTK's XML files that name no other files; for other types VTK would read any file they name."""

UNREACHABLE_POINT_COUNT = 2**62
"""More points than any cell has: cells that must not be read never have enough."""


def with_vtk_fallback(read: Read) -> Read:
    """Return a reader that falls back to the VTK library, if installed, for files that `read` refuses."""

    def read_either(path: Path, wanted: str | None) -> GridFile:
        try:
            return read(path, wanted)
        except InputError as refused:
            if not path.is_file():
                raise
            # The package may be absent, or blocked as a module.
            if sys.modules.get(PACKAGE, find_spec(PACKAGE)) is None:
                message = f"{refused.message}; VTK itself may read it: pip install 'pdecodec[vtk]'"
                raise refused.placed(message, path=path) from refused
            try:
                return _read_in_worker(path, wanted)
            except InputError:
                raise refused from None

    return read_either


worker = Worker(arrays_only=True)
"""The process that runs VTK: started when first needed, and again after a crash."""

atexit.register(worker.end)


def _read_in_worker(path: Path, wanted: str | None) -> GridFile:
    found = call_about_file(worker, path, _answer, wanted)
    whole = Connectivity(len(found["points"]), *(found[f"part{k}"] for k in range(4)))
    attributes = (node_attribute(found["node"]),) if "node" in found else ()
    mesh = MeshFile(found["points"], whole, attributes, tuple(map(str, found["notices"])))
    vectors, point_data, cell_data, field_data = (tuple(map(str, found[name])) for name in _NAMES)
    time = float(found["time"][0]) if "time" in found else None
    return GridFile(mesh, vectors, point_data, cell_data, found.get("added"), time, field_data)


def _answer(path: Path, wanted: str | None) -> dict[str, Any]:
    _limit_memory(path)
    grid = read_with_vtk(path, wanted)
    mesh = grid.mesh
    whole = mesh.connectivity
    parts = (whole.face_counts, whole.face_indices, whole.line_counts, whole.line_indices)
    arrays: dict[str, Any] = {f"part{number}": part for number, part in enumerate(parts)}
    arrays |= {one.name: one.values for one in mesh.attributes}
    if grid.added is not None:
        arrays["added"] = grid.added
    if grid.time is not None:
        arrays["time"] = np.array([grid.time])
    names = {name: np.array(getattr(grid, name), np.str_) for name in _NAMES}
    return {**arrays, **names, "points": mesh.points, "notices": np.array(mesh.notices, np.str_)}


def _limit_memory(path: Path) -> None:
    """Limit the memory of this process to what a file of that size needs."""
    try:
        import resource
    except ModuleNotFoundError:  # Windows
        return
    most, hard = BASE_MEMORY + MEMORY_FACTOR * path.stat().st_size, resource.getrlimit(resource.RLIMIT_AS)[1]
    if hard == resource.RLIM_INFINITY or most <= hard:
        resource.setrlimit(resource.RLIMIT_AS, (most, hard))


def read_with_vtk(path: Path, wanted: str | None) -> GridFile:
    """Return one file's grid, with the vectors named `wanted` if it has them.

    Raises
    ------
    InputError
        If VTK cannot read it, or it holds no points.
    """
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkObject
    from vtkmodules.vtkFiltersGeometry import vtkGeometryFilter
    from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader
    from vtkmodules.vtkIOXML import vtkXMLGenericDataObjectReader

    vtkObject.GlobalWarningDisplayOff()
    is_legacy = read_regular(path, len(b"# vtk")) == b"# vtk"
    if not is_legacy and (kind := _xml_type(path)) not in _SELF_CONTAINED_TYPES:
        raise damaged(f"its type is {kind}, which does not match its name; rename or export it again", path=path)
    reader = vtkGenericDataObjectReader() if is_legacy else vtkXMLGenericDataObjectReader()
    reader.SetFileName(str(path))
    reader.Update()
    data: Any = reader.GetOutput()
    if data is None or not data.IsA("vtkPointSet") or not data.GetNumberOfPoints():
        kind = "nothing" if data is None else data.GetClassName()
        raise InputError(
            f"VTK finds no points with cells in it ({kind}); check or export it again", code="no-vertices", path=path
        )
    nodes, gather = data.GetNumberOfPoints(), None
    stored = data.GetFieldData().GetArray(TIME)
    time = stored.GetTuple1(0) if stored is not None and stored.GetNumberOfValues() == 1 else None
    _check_cells(data, path)
    point_data, cell_data, field_data = (
        [str(fields.GetArrayName(index)) for index in range(fields.GetNumberOfArrays())]
        for fields in (data.GetPointData(), data.GetCellData(), data.GetFieldData())
    )
    others = tuple(name for name in field_data if name != TIME)
    numeric = {name: data.GetPointData().GetArray(name) for name in point_data}
    values = {name: vtk_to_numpy(array) for name, array in numeric.items() if array is not None}
    vectors = tuple(name for name, array in values.items() if is_vectors(array))
    added = values[wanted] if wanted in vectors and wanted is not None else None
    if not data.IsA("vtkPolyData"):
        surface = vtkGeometryFilter()
        surface.PassThroughPointIdsOn()
        surface.SetOriginalPointIdsName(ORIGINAL_POINT_IDS)
        surface.SetInputData(data)
        surface.Update()
        data = surface.GetOutput()
        ids = data.GetPointData().GetArray(ORIGINAL_POINT_IDS)
        if ids is None or not data.GetNumberOfPoints():
            raise InputError("VTK finds no surface in it; extract it as polygons first", code="no-vertices", path=path)
        gather = vtk_to_numpy(ids).astype(np.int64)
    points = vtk_to_numpy(data.GetPoints().GetData())

    def cells(array: Any) -> tuple[NDArray[Any], NDArray[Any]]:
        offsets = vtk_to_numpy(array.GetOffsetsArray()).astype(np.int64)
        return np.diff(offsets), vtk_to_numpy(array.GetConnectivityArray()).astype(np.int64)

    faces = cells(data.GetPolys())
    lines = [np.concatenate(both) for both in zip(cells(data.GetVerts()), cells(data.GetLines()), strict=True)]
    strips = [strip_triangles(row) for row in _rows(*cells(data.GetStrips()))]
    if strips:
        corners = np.concatenate(strips)
        faces = np.append(faces[0], np.full(len(corners), 3)), np.append(faces[1], corners)
    attributes: tuple[Attribute, ...] = ()
    if gather is not None:
        # Restore the order that points have in the file.
        order = np.argsort(gather)
        place = np.argsort(order)
        points, gather = points[order], gather[order]
        added = None if added is None else gather_rows(added, gather, nodes)
        faces, lines = (faces[0], place[faces[1]]), [lines[0], place[lines[1]]]
        if gather.size < nodes:
            attributes = (node_attribute(gather),)
        else:
            gather = None
    connectivity = Connectivity(len(points), *faces, *lines)
    mesh = MeshFile(points, connectivity, attributes, left_out_notice(gather, nodes))
    return GridFile(mesh, vectors, tuple(point_data), tuple(cell_data), added, time, others)


def _xml_type(path: Path) -> str | None:
    """Return the type in the root of an XML file, None if it has none."""
    try:
        with open_regular(path) as file:
            root: ElementTree.Element = next(ElementTree.iterparse(file, ("start",)))[1]
            return root.get("type")
    except (ElementTree.ParseError, StopIteration, ValueError):
        return None


def _check_cells(data: Any, path: Path) -> None:
    """Raise InputError if cells refer to missing points: VTK's filters would read out of bounds."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkGenericCell

    if data.IsA("vtkPolyData"):
        arrays = [data.GetVerts(), data.GetLines(), data.GetPolys(), data.GetStrips()]
    else:
        arrays = [data.GetCells()] if data.IsA("vtkUnstructuredGrid") else []
    fit = True
    for array in arrays:
        if array is None or not array.GetNumberOfCells():
            continue
        offsets = vtk_to_numpy(array.GetOffsetsArray()).astype(np.int64)
        points = vtk_to_numpy(array.GetConnectivityArray()).astype(np.int64)
        ordered = offsets[0] == 0 and (np.diff(offsets) >= 0).all() and offsets[-1] == points.size
        inside = not points.size or 0 <= points.min() <= points.max() < data.GetNumberOfPoints()
        fit = fit and bool(ordered) and bool(inside)
    if fit and data.IsA("vtkUnstructuredGrid") and data.GetNumberOfCells():
        # GetCellTypesArray was renamed GetCellTypes in VTK 9.6.
        stored = data.GetCellTypes() if hasattr(data, "GetDistinctCellTypes") else data.GetCellTypesArray()
        kinds = vtk_to_numpy(stored).astype(np.int64)
        sizes = np.diff(vtk_to_numpy(data.GetCells().GetOffsetsArray()).astype(np.int64))
        least = np.full(256, UNREACHABLE_POINT_COUNT)
        for number in np.unique(kinds[kinds < FIRST_IRREGULAR_CELL_TYPE]).tolist():
            cell = vtkGenericCell.InstantiateCell(number)
            least[number] = UNREACHABLE_POINT_COUNT if cell is None else cell.GetNumberOfPoints()
        fit = kinds.size == sizes.size and bool((sizes >= least[kinds]).all())
    if not fit:
        raise damaged("its cells refer to missing points; export it again", path=path)


def _rows(counts: Int64Array, indices: Int64Array) -> list[Int64Array]:
    return np.split(indices, np.cumsum(counts)[:-1]) if counts.size else []
