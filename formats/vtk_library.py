"""VTK's files through the library itself (extra ``vtk``): what meshio and our own reader of VTP do not read.

Any XML or legacy data set with points: unstructured grids, polygonal data, structured grids; what is solid gives its
surface, with the numbers of its points.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.formats.cells import left_out_notice, node_attribute
from pdecodec.formats.frame_files import MeshFile
from pdecodec.sequence import Connectivity

ORIGINAL = "vtkOriginalPointIds"
"""Point data in which the surface filter says which points it took."""


def else_vtk(read: Callable[[Path], MeshFile]) -> Callable[[Path], MeshFile]:
    """A reader of a file, or the library where that refuses it and the library is installed."""

    def read_either(path: Path) -> MeshFile:
        try:
            return read(path)
        except InputError as refused:
            if not path.is_file():
                raise
            try:
                return read_with_vtk(path)
            except ModuleNotFoundError:
                message = f"{refused.message}; VTK itself may read it: pip install 'pdecodec[vtk]'"
                raise InputError(message, path=path) from refused
            except InputError:
                raise refused from None

    return read_either


def read_with_vtk(path: Path) -> MeshFile:
    """One file's mesh.

    Raises
    ------
    InputError
        If VTK cannot read it, or it holds no points.
    ModuleNotFoundError
        If VTK is not installed.
    """
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkObject
    from vtkmodules.vtkFiltersGeometry import vtkGeometryFilter
    from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader
    from vtkmodules.vtkIOXML import vtkXMLGenericDataObjectReader

    vtkObject.GlobalWarningDisplayOff()
    with path.open("rb") as file:
        is_legacy = file.read(len(b"# vtk")) == b"# vtk"
    reader = vtkGenericDataObjectReader() if is_legacy else vtkXMLGenericDataObjectReader()
    reader.SetFileName(str(path))
    reader.Update()
    data: Any = reader.GetOutput()
    if data is None or not data.IsA("vtkPointSet") or not data.GetNumberOfPoints():
        kind = "nothing" if data is None else data.GetClassName()
        raise InputError(f"VTK finds no points with cells in it ({kind}); check or export it again", path=path)
    nodes, gather = data.GetNumberOfPoints(), None
    names = [
        str(fields.GetArrayName(index))
        for fields in (data.GetPointData(), data.GetCellData())
        for index in range(fields.GetNumberOfArrays())
    ]
    if not data.IsA("vtkPolyData"):
        surface = vtkGeometryFilter()
        surface.PassThroughPointIdsOn()
        surface.SetOriginalPointIdsName(ORIGINAL)
        surface.SetInputData(data)
        surface.Update()
        data = surface.GetOutput()
        ids = data.GetPointData().GetArray(ORIGINAL)
        if ids is None or not data.GetNumberOfPoints():
            raise InputError("VTK finds no surface in it; extract it as polygons first", path=path)
        gather = vtk_to_numpy(ids).astype(np.int64)
    points = vtk_to_numpy(data.GetPoints().GetData()).astype(np.float32)

    def cells(array: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        offsets = vtk_to_numpy(array.GetOffsetsArray()).astype(np.int64)
        return np.diff(offsets), vtk_to_numpy(array.GetConnectivityArray()).astype(np.int64)

    faces = cells(data.GetPolys())
    lines = [np.concatenate(both) for both in zip(cells(data.GetVerts()), cells(data.GetLines()), strict=True)]
    strips = [_triangles(row) for row in _rows(*cells(data.GetStrips()))]
    if strips:
        corners = np.concatenate(strips)
        faces = np.append(faces[0], np.full(len(corners), 3)), np.append(faces[1], corners)
    attributes = ()
    if gather is not None:
        # In the order that the points have in the file.
        order = np.argsort(gather)
        place = np.argsort(order)
        points, gather = points[order], gather[order]
        faces, lines = (faces[0], place[faces[1]]), [lines[0], place[lines[1]]]
        if gather.size < nodes:
            attributes = (node_attribute(gather),)
        else:
            gather = None
    notices = (f"not kept: {', '.join(names)}",) if names else ()
    connectivity = Connectivity(len(points), *faces, *lines)
    return MeshFile(points, connectivity, attributes, (*notices, *left_out_notice(gather, nodes)))


def _rows(counts: NDArray[np.int64], indices: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    return np.split(indices, np.cumsum(counts)[:-1]) if counts.size else []


def _triangles(strip: NDArray[np.int64]) -> NDArray[np.int64]:
    """(triangles, 3): every second one turned round."""
    steps = np.arange(max(0, strip.size - 2))
    odd = steps % 2
    return strip[np.stack([steps, steps + 1 + odd, steps + 2 - odd], axis=1)]
