"""Make VTK data sets of the objects of an animation: what is constant once, positions and fields for each time."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
from vtkmodules.vtkCommonCore import vtkPoints, vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData, vtkUnstructuredGrid

from pdecodec import Animation, Attribute, Connectivity, MeshObject, bake_transforms

CELL_TYPES: tuple[dict[int, int], ...] = (
    {1: 1}, {1: 1, 2: 3, 3: 21, 4: 35}, {}, {3: 5, 6: 22, 7: 34}, {4: 9, 8: 23, 9: 28}, {4: 10, 10: 24},
    {5: 14, 13: 27, 19: 37}, {6: 13, 12: 31, 15: 26, 18: 32}, {8: 12, 20: 25, 24: 33, 27: 29},
)  # fmt: skip
"""For each shape of cells (:class:`pdecodec.Connectivity`), VTK's type by the number of nodes."""

TYPES_OF_ANY_SIZE = {0: 4, 2: 7}
"""VTK's types of polylines and polygons, by shape."""

HIDDEN = ("normal_group", "shared_normal")
"""Attributes that only say where edges are hard."""

VELOCITY = "velocity"
"""Name of the point data with the derivative of the positions [scene units / s]."""


class RunBlocks:
    """The objects of one run of frames as data sets, in the space of the scene.

    Parameters
    ----------
    run : Animation
        A run: its connectivity is constant.

    Attributes
    ----------
    names : list of str
        Of the objects.
    """

    def __init__(self, run: Animation) -> None:
        self.run, self._placed = run, bake_transforms(run)
        self.names = [item.name for item in run.objects]
        self._constant = [_constant_data(item) for item in self._placed.objects]

    def at(
        self, time: float, fields: Collection[str], *, velocity: bool = False, owned: slice = slice(None)
    ) -> Iterator[tuple[int, Any]]:
        """Yield the indices of objects and their data sets at a time, within the clip [s].

        Parameters
        ----------
        time : float [s]
        fields : collection of str
            Names of the fields to add.
        velocity : bool
            Whether to add the derivative of the positions.
        owned : slice
            Which objects to return.
        """
        run = self._placed
        positions, rates = run.positions(time), run.velocities(time) if velocity else None
        values = [(one, run.field(one.name, time)) for one in run.fields if one.name in fields]
        ends = np.cumsum([item.vertex_count for item in run.objects]).tolist()
        for index, item in [*enumerate(run.objects)][owned]:
            rows, mesh = slice(ends[index] - item.vertex_count, ends[index]), item.connectivity
            data = self._constant[index].NewInstance()
            data.ShallowCopy(self._constant[index])
            points = vtkPoints()
            points.SetData(numpy_to_vtk(positions[rows]))
            data.SetPoints(points)
            if rates is not None:
                _add(data, mesh, "vertex", VELOCITY, rates[rows], suffix="derivative")
            for field, found in values:
                own = found[field.slices(run.objects)[index]]
                if len(own):
                    _add(data, mesh, field.domain, field.name, own)
            yield index, data


def _constant_data(item: MeshObject) -> Any:
    """Return an object without positions: an unstructured grid if it has cells, polygons and lines otherwise."""
    mesh = item.connectivity
    if mesh.cell_count:
        data = vtkUnstructuredGrid()
        types, counts, indices = _vtk_cells(mesh)
        data.SetCells(numpy_to_vtk(types, deep=True), _cell_array(counts, indices))
    else:
        data = vtkPolyData()
        points, rows = _line_split(mesh)
        if mesh.face_count:
            data.SetPolys(_cell_array(mesh.face_counts, mesh.face_indices))
        if points.any():
            data.SetVerts(_cell_array(mesh.line_counts[points], mesh.line_indices[rows]))
        if not points.all():
            data.SetLines(_cell_array(mesh.line_counts[~points], mesh.line_indices[~rows]))
        if not (mesh.face_count or mesh.line_count):  # a cloud of points is drawn only if it has cells
            every = np.arange(mesh.vertex_count)
            data.SetVerts(_cell_array(np.ones_like(every), every))
    for attribute in item.attributes:
        if attribute.name not in HIDDEN:
            _add_attribute(data, mesh, attribute)
    return data


def _line_split(mesh: Connectivity) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which lines are points, which VTK keeps apart, and which indices are theirs."""
    points = mesh.line_counts == 1
    return points, np.repeat(points, mesh.line_counts)


def _vtk_cells(mesh: Connectivity) -> tuple[NDArray[np.uint8], NDArray[Any], NDArray[Any]]:
    """Return VTK's types, counts and nodes of cells; cells of kinds that VTK lacks keep their corners alone."""
    types, kept = np.zeros(mesh.cell_count, np.uint8), mesh.cell_counts.copy()
    for shape, nodes in np.unique(np.stack([mesh.cell_shapes, mesh.cell_counts]), axis=1).T.tolist():
        known, rows = CELL_TYPES[shape], (mesh.cell_shapes == shape) & (mesh.cell_counts == nodes)
        if nodes not in known and shape not in TYPES_OF_ANY_SIZE:
            kept[rows] = nodes = max(count for count in known if count <= nodes and count <= 8)
        types[rows] = known.get(nodes) or TYPES_OF_ANY_SIZE[shape]
    starts = np.repeat(np.cumsum(mesh.cell_counts) - mesh.cell_counts, mesh.cell_counts)
    places = np.arange(mesh.cell_indices.size) - starts
    return types, kept, mesh.cell_indices[places < np.repeat(kept, mesh.cell_counts)]


def _cell_array(counts: NDArray[Any], indices: NDArray[Any]) -> Any:
    cells = vtkCellArray()
    offsets = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
    cells.SetData(
        numpy_to_vtkIdTypeArray(offsets, deep=True), numpy_to_vtkIdTypeArray(indices.astype(np.int64), deep=True)
    )
    return cells


def _add_attribute(data: Any, mesh: Connectivity, attribute: Attribute) -> None:
    values, domain = attribute.values, str(attribute.domain)
    if attribute.labels:  # -1 is no label
        values = values.astype(np.int32)
    missing = -1 if attribute.labels else np.nan if values.dtype.kind == "f" else 0
    if attribute.indices is not None:
        nothing = np.full((1, *values.shape[1:]), missing, values.dtype)
        values = np.concatenate([values, nothing])[attribute.indices]
    if domain == "corner":
        first = np.zeros(mesh.vertex_count, np.int64)
        first[mesh.face_indices] = np.arange(mesh.face_indices.size)
        of_vertices = values[first] if len(values) else values
        if not len(values) or not np.array_equal(of_vertices[mesh.face_indices], values, equal_nan=True):
            return  # VTK has no values of corners
        values, domain = of_vertices, "vertex"
    array = _add(data, mesh, domain, attribute.name, values, missing=missing, suffix=str(attribute.domain))
    if array is not None and attribute.labels:
        labels = vtkStringArray()
        labels.SetName(f"{array.GetName()} labels")
        for label in attribute.labels:
            labels.InsertNextValue(label)
        data.GetFieldData().AddArray(labels)
    if attribute.name == "uv" and domain == "vertex":
        data.GetPointData().SetTCoords(array)


def _add(
    data: Any, mesh: Connectivity, domain: str, name: str, values: NDArray[Any], *,
    missing: float | None = None, suffix: str = "field",
) -> Any:  # fmt: skip
    """Add values to the data of points, of cells or of the whole object, and return their array.

    Values on corners, and on faces of an object with cells, have no place in VTK. An array whose name is taken is
    ``NAME_`` and a suffix.
    """
    if domain == "corner" or (domain == "face" and mesh.cell_count):
        return None
    if domain == "face" and mesh.line_count:  # lines come before faces
        missing = (np.nan if values.dtype.kind == "f" else 0) if missing is None else missing
        values = np.concatenate([np.full((mesh.line_count, *values.shape[1:]), missing, values.dtype), values])
    array = numpy_to_vtk(np.ascontiguousarray(values.view(np.uint8) if values.dtype == bool else values))
    place = {"vertex": data.GetPointData, "object": data.GetFieldData}.get(domain, data.GetCellData)()
    while place.HasArray(name):
        name += f"_{suffix}"
    array.SetName(name)
    place.AddArray(array)
    return array
