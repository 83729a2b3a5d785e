"""Read XDMF: a small XML file with a grid per time step that refers to data in HDF5 files.

``xdmf_document.py`` follows includes and references, ``xdmf_grids.py`` finds steps, their times and parts,
``xdmf_items.py`` reads values, ``xdmf_cells.py`` cells, ``xdmf_attributes.py`` fields. Features of XDMF that these do
not support are refused by name. Here steps become frames: each with its own geometry, or one geometry moved by vectors
that the user names.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged, naming_file
from pdecodec.formats.arrays.hdf5 import HDF5_DAMAGE
from pdecodec.formats.base.times import rate_or_default, timing_of_stored
from pdecodec.formats.vtk.cells import Solids, node_attribute
from pdecodec.formats.vtk.motion import choose_vectors, contents_of, motion_notices, moved, not_kept_data
from pdecodec.formats.vtk.xdmf_attributes import (
    CENTERS,
    AttributeFields,
    Rows,
    are_degrees_of_freedom,
    center_of,
)
from pdecodec.formats.vtk.xdmf_cells import cells_of
from pdecodec.formats.vtk.xdmf_document import Document, Element
from pdecodec.formats.vtk.xdmf_grids import Grids, Part, Step
from pdecodec.formats.vtk.xdmf_items import Items
from pdecodec.mesh.arrays import Float32Array, Int64Array
from pdecodec.mesh.fields import Field, FieldDomain
from pdecodec.mesh.rounding import to_float32
from pdecodec.mesh.sequence import Connectivity, MeshObject, MeshSequence, check_frame_range
from pdecodec.mesh.times import check_times

_AXES = {"XYZ": 3, "XY": 2, "X_Y_Z": 3, "X_Y": 2}
"""Number of axes of the supported geometry types; those with underscores have a DataItem per axis."""


class XdmfSequence(MeshSequence):
    """Steps of an XDMF file, with an object per part; its HDF5 files stay open until :meth:`close`.

    `fps` is the nominal rate if steps have times; otherwise frames are counted at it. `displacement` names the
    vectors on nodes that are added to the geometry; `solids` says what becomes of solids.

    Raises
    ------
    InputError
        If the file is damaged, values were never written, it uses an unsupported feature, its connectivity changes, or
        no vectors have the name `displacement`.
    """

    def __init__(
        self, path: Path, *, fps: float | None, displacement: str | None = None, solids: Solids | None = None
    ) -> None:
        self._path, self._solids = path, solids or "surface"
        document = Document(path)
        self._items = Items(document)
        try:
            with naming_file(path):
                self._open(Grids(document, self._items), fps, displacement)
        except InputError:
            self.close()
            raise
        except HDF5_DAMAGE as error:
            self.close()
            raise damaged(f"is damaged, or its HDF5 file is missing ({error})", path=path) from error

    def _open(self, grids: Grids, fps: float | None, displacement: str | None) -> None:
        timeline = grids.timeline(displacement)
        self._steps = [self._sort_parts(step, timeline.steps[0]) for step in timeline.steps]
        self.times, self.fps, notices = self._timing(fps)
        first = self._steps[0].parts
        vectors = _vectors(first)
        self._moving = choose_vectors(vectors, displacement, self._path)
        names, objects = _object_names(first), []
        self._gathers: list[Int64Array | None] = []
        self._nodes: list[int] = []
        left_out: dict[str, None] = {}
        rows: list[Mapping[FieldDomain, Rows]] = []
        cells_of_parts = [cells_of(part.topology, self._items, self._path, self._solids) for part in first]
        # If a part has solids to keep, data of cells belong to cells in all parts.
        self._has_cells = any(cells.has_cells for cells in cells_of_parts)
        for name, part, cells in zip(names, first, cells_of_parts, strict=True):
            points = self._geometry(part)
            cells.has_cells = self._has_cells
            connectivity, gather = cells.connectivity(points)
            vertices = slice(None) if gather is None else gather
            rows.append({
                "vertex": Rows(len(points), vertices, connectivity.vertex_count),
                "face": Rows(cells.count, cells.owners, connectivity.face_count),
                "object": Rows(1, slice(None), 1),
                **({"cell": Rows(cells.count, slice(None), cells.count)} if self._has_cells else {}),
            })  # fmt: skip
            attributes = () if gather is None else (node_attribute(gather),)
            objects.append(MeshObject(name, connectivity, attributes))
            self._gathers.append(gather)
            self._nodes.append(len(points))
            told = cells.left_out_notices(gather, len(points))
            if any(center_of(one) == "cell" for one in part.attributes):
                told += cells.inner_notice("cells", "cell data")
            left_out.update(dict.fromkeys(told))
        self.objects = tuple(objects)
        self._topologies = [self._items.key(part.topology) for part in first]
        self.metadata = {}
        self._attributes = AttributeFields(self._steps, rows, self._items, self._moving)
        self.fields = self._attributes.fields
        read = [*self._attributes.kept, *([] if self._moving is None else [("node", self._moving)])]
        kept = {CENTERS[center]: [name for at, name in read if at == center] for center, _ in read}
        kept["times"] = ["Time"] if self._steps[0].time is not None else []
        lost = _dropped(self._steps, read, timeline.others, grids.loose) | grids.information()
        self.list_contents = lambda: contents_of(self.objects, kept, lost)
        self.notices = (
            *notices,
            *timeline.notices,
            *motion_notices(self._moving, vectors, displacement, moves=self._geometry_moves(vectors)),
            *not_kept_data(lost),
            *left_out,
        )

    def _timing(self, fps: float | None) -> tuple[NDArray[np.float64], float, tuple[str, ...]]:
        times = [step.time for step in self._steps if step.time is not None]
        if len(times) == len(self._steps):
            return timing_of_stored(np.array(times, np.float64), fps)
        rate, notices = rate_or_default(None, fps)
        return *check_times(len(self._steps), None, rate), notices

    def _sort_parts(self, step: Step, first: Step) -> Step:
        """Return a step with its parts in the order of the first step, if the names of parts are the same."""
        names, wanted = ([part.name for part in one.parts] for one in (step, first))
        if len(names) != len(wanted):
            raise InputError(
                f"the step at time {step.time} has {len(names)} parts, the first one {len(wanted)}; "
                "write as many of each",
                code="connectivity-changes",
                path=self._path,
            )
        if names == wanted or sorted(names) != sorted(wanted) or len(set(names)) < len(names):
            return step
        places = dict(zip(names, step.parts, strict=True))
        return Step(step.time, tuple(places[name] for name in wanted))

    def _geometry(self, part: Part) -> NDArray[np.floating]:
        """Return the points (nodes, 3) of a part, without displacement."""
        kind = str(part.geometry.get("GeometryType", part.geometry.get("Type", "XYZ"))).upper()
        if kind not in _AXES:
            raise InputError(
                f"geometry of type {kind} of grid {part.name!r} is not read; write XYZ",
                code="unsupported-feature",
                path=self._path,
            )
        axes = _AXES[kind]
        if "_" in kind:
            items = self._items.of(part.geometry)
            if len(items) != axes:
                raise InputError(
                    f"geometry of type {kind} has {len(items)} DataItems", code="damaged-input", path=self._path
                )
            stored = np.stack([self._items.numbers(item).reshape(-1) for item in items], axis=1)
        else:
            stored = self._items.only(part.geometry).reshape(-1, axes)
        points = np.zeros((len(stored), 3), np.result_type(stored, np.float32))
        points[:, :axes] = stored
        return points

    def _points(self, part: Part) -> NDArray[np.floating]:
        points = self._geometry(part)
        if self._moving is None:
            return points
        found = next((one for one in part.attributes if one.get("Name") == self._moving and _is_vector(one)), None)
        if found is None:
            raise InputError(
                f"grid {part.name!r} has no vectors {self._moving!r} on its nodes",
                code="object-missing",
                path=self._path,
            )
        vectors = self._items.only(found)
        return moved(points, vectors.reshape(len(vectors), -1), self._moving, self._path)

    def _connectivity(self, part: Part, points: NDArray[np.floating]) -> tuple[Connectivity, Int64Array | None]:
        cells = cells_of(part.topology, self._items, self._path, self._solids)
        cells.has_cells = self._has_cells
        return cells.connectivity(points)

    def _geometry_moves(self, vectors: Sequence[str]) -> bool:
        """Return whether the geometry changes; three of the steps that refer to other data are compared."""
        if not vectors:
            return True
        keys = [[self._items.key(part.geometry) for part in step.parts] for step in self._steps]
        differing = [number for number, key in enumerate(keys) if key != keys[0]]
        chosen = {differing[0], differing[len(differing) // 2], differing[-1]} if differing else set()
        first = self._steps[0].parts
        return any(
            not np.array_equal(self._geometry(mine), self._geometry(theirs))
            for number in sorted(chosen)
            for mine, theirs in zip(self._steps[number].parts, first, strict=True)
        )

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        values = np.empty((stop - start, field.row_count(self.objects), field.components), field.dtype)
        for frame in range(start, stop):
            with self._errors_of(frame):
                values[frame - start] = self._attributes.read(field, frame, self.objects)
        return values.reshape(field.shape(stop - start, self.objects))

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        found = np.empty((stop - start, self.vertex_count, 3), np.float32)
        for frame in range(start, stop):
            with self._errors_of(frame):
                self._read_frame(frame, found[frame - start])
        return found

    @contextmanager
    def _errors_of(self, frame: int) -> Iterator[None]:
        """Turn exceptions on damage into an InputError that names the frame."""
        try:
            yield
        except InputError as error:
            raise error.placed(frame=frame, path=error.path or self._path) from error
        except HDF5_DAMAGE as error:
            raise InputError(
                f"this frame cannot be read ({error})", code="unreadable", path=self._path, frame=frame
            ) from error

    def _read_frame(self, frame: int, into: Float32Array) -> None:
        """Read positions (vertices, 3) of a frame; InputError if its connectivity differs from the first frame's."""
        done = 0
        for number, part in enumerate(self._steps[frame].parts):
            points, item = self._points(part), self.objects[number]
            same = self._items.key(part.topology) == self._topologies[number]
            if len(points) != self._nodes[number] or not (
                same or self._connectivity(part, points)[0].same_as(item.connectivity)
            ):
                message = "its connectivity differs from that of the first frame; write frames of one connectivity"
                raise InputError(message, code="connectivity-changes", path=self._path, frame=frame)
            gather = self._gathers[number]
            into[done : done + item.vertex_count] = to_float32(points if gather is None else points[gather])
            done += item.vertex_count

    def close(self) -> None:
        self._items.close()


def _is_vector(attribute: Element) -> bool:
    """Return whether an attribute is a vector of two or three components per node."""
    if center_of(attribute) != "node" or are_degrees_of_freedom(attribute):
        return False
    kind = attribute.get("AttributeType", attribute.get("Type", "Scalar")).lower()
    items: Iterable[Any] = attribute.findall("DataItem")
    shapes = [str(item.get("Dimensions", "")).split() for item in items]
    if len(shapes) == 1 and len(shapes[0]) == 2:
        return kind in ("vector", "matrix") and shapes[0][1] in ("2", "3")
    return kind == "vector"


def _vectors(parts: Sequence[Part]) -> list[str]:
    """Return the names of vectors on the nodes of every part."""
    names = [[str(one.get("Name")) for one in part.attributes if _is_vector(one)] for part in parts]
    return [name for name in dict.fromkeys(names[0]) if all(name in others for others in names)]


def _dropped(
    steps: Sequence[Step], read: Collection[tuple[str, str]], others: Sequence[Step], loose: Sequence[Element]
) -> dict[str, dict[str, None]]:
    """Return the names of attributes and sets that are not kept, by kind.

    Kept are attributes of `steps` that are `read`, (Center, Name). The steps `others` are not read, and the attributes
    `loose` belong to no part.
    """
    found: dict[str, dict[str, None]] = {}
    for one in loose:
        found.setdefault("data of collections", {})[str(one.get("Name"))] = None
    for step, names in (*((one, read) for one in steps), *((one, ()) for one in others)):
        for part in step.parts:
            for one in part.attributes:
                name, center = str(one.get("Name")), center_of(one)
                kind = CENTERS.get(center, f"data of center {center}")
                if are_degrees_of_freedom(one):
                    kind = "degrees of freedom (FiniteElementFunction)"
                elif (center, name) in names:
                    continue
                found.setdefault(kind, {})[name] = None
            for one in part.sets:
                found.setdefault("sets", {})[str(one.get("Name"))] = None
    return found


def _object_names(parts: Sequence[Part]) -> list[str]:
    """Return a unique name for each part; a single part is called ``mesh``."""
    if len(parts) == 1:
        return ["mesh"]
    names: dict[str, None] = {}
    for number, part in enumerate(parts):
        name = part.name or f"part{number}"
        # A generated name may already be taken.
        while name in names:
            name = f"{name}_{number}"
        names[name] = None
    return list(names)
