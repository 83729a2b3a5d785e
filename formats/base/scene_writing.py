"""Code that writers of scenes share: names as paths of a tree, shapes and their samples, attributes as parameters.

A file has one shape for an object in all runs of frames. In runs without the object the shape is empty.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.attribute_roles import (
    COLOR,
    CURVE_BASIS,
    CURVE_WRAP,
    GROUP,
    ID,
    MATERIAL,
    SUBDIVISION,
    UV,
    colors,
    expanded,
    face_sets,
    indexed_rows,
    is_role,
    label_of,
    unique_name,
    uv_sets,
    vertex_slices,
)
from pdecodec.formats.base.normals import NORMAL_GROUP, normal_rows
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.transforms import TRANSFORM
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import Attribute, Connectivity, MeshObject, MeshSequence

DEFAULT_NAME = "mesh"
"""Name of an object, or of a step of its path, that has none."""

_WRITTEN_ELSEWHERE = frozenset({SUBDIVISION, CURVE_BASIS, CURVE_WRAP, TRANSFORM})
"""Attributes that are stored otherwise: as the kind of a shape, or as its transform."""


def path_steps(name: str) -> tuple[str, ...]:
    """Return the steps of an object's path."""
    return tuple(step for step in name.split("/") if step)


def tree_paths(
    names: Sequence[str], valid: Callable[[str], str] = lambda name: name
) -> tuple[list[tuple[str, ...]], tuple[str, ...]]:
    """Return paths of objects from their names, and a notice about names that had to change.

    Each path is unique and has at least one step; none is a parent of another. `valid` turns a step that the format
    cannot hold into one that it can hold.
    """
    taken: set[tuple[str, ...]] = set()
    branches: set[tuple[str, ...]] = set()
    paths: list[tuple[str, ...]] = []
    wanted = [path_steps(name) or (DEFAULT_NAME,) for name in names]
    for steps in wanted:
        branches.update(tuple(map(valid, steps[:length])) for length in range(1, len(steps)))
    for steps in wanted:
        path = tuple(map(valid, steps))
        number = 1
        while path in taken or path in branches:
            number += 1
            path = (*path[:-1], valid(f"{steps[-1]}_{number}"))
        taken.add(path)
        paths.append(path)
    return paths, renamed(zip(names, map("/".join, paths), strict=True))


def renamed(pairs: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Return a notice about names that had to change, from pairs of old and new name; empty if none did."""
    changes = ", ".join(dict.fromkeys(f"{name!r} as {found!r}" for name, found in pairs if name != found))
    return (f"names that had to change: {changes}",) if changes else ()


FACE_SETS = (GROUP, MATERIAL)
"""Roles of attributes that name sets of faces."""


def named_face_sets(
    item: MeshObject, valid: Callable[[str], str], roles: Sequence[str] = FACE_SETS
) -> Iterator[tuple[str, str, str, Int32Array]]:
    """Yield role, label, name (unique in the object) and member faces of each set of faces with one of `roles`."""
    taken: set[str] = set()
    for role in roles:
        for label, members in face_sets(item, role):
            yield role, label, unique_name(valid(label or role), taken), members


Kind = Literal["mesh", "curves", "points"]


@dataclass(frozen=True)
class ShapeForm:
    """What an object is in formats where meshes, curves and points are separate.

    Attributes
    ----------
    kind : {"mesh", "curves", "points"}
        A mesh if it has faces; curves if it has only lines and every vertex is in one; else points.
    gather : (line points,) int32 or None
        Vertex of each point of its curves, unless these are all vertices in order.
    hidden_lines : bool
        Whether it has lines that do not show, because it also has faces, or vertices that are in no line.
    """

    kind: Kind
    gather: Int32Array | None = None
    hidden_lines: bool = False


def find_shape_form(connectivity: Connectivity) -> ShapeForm:
    """Return what an object of this connectivity is drawn as."""
    if connectivity.face_count:
        return ShapeForm("mesh", hidden_lines=connectivity.line_count > 0)
    if not connectivity.line_count:
        return ShapeForm("points")
    indices = connectivity.line_indices
    if connectivity.line_counts.min() < 2 or np.unique(indices).size < connectivity.vertex_count:
        return ShapeForm("points", hidden_lines=True)
    in_order = np.array_equal(indices, np.arange(connectivity.vertex_count))
    return ShapeForm("curves", gather=None if in_order else indices)


@dataclass(frozen=True)
class ShapeKey:
    """Properties that the objects of several runs share if they are the same shape.

    Attributes
    ----------
    name : str
    number : int
        From 0, among objects of one run that agree in all other properties.
    kind : {"mesh", "curves", "points"}
    subdivision, curve_basis, curve_wrap : str or None
        Labels that formats store once per shape.
    """

    name: str
    number: int
    kind: Kind
    subdivision: str | None
    curve_basis: str | None
    curve_wrap: str | None


def _keys_of(objects: Sequence[MeshObject]) -> list[ShapeKey]:
    counts: Counter[ShapeKey] = Counter()
    keys = []
    for item in objects:
        subdivision, basis, wrap = (label_of(item, name) for name in (SUBDIVISION, CURVE_BASIS, CURVE_WRAP))
        first = ShapeKey(item.name, 0, find_shape_form(item.connectivity).kind, subdivision, basis, wrap)
        keys.append(dataclasses.replace(first, number=counts[first]))
        counts[first] += 1
    return keys


def shape_keys(sequence: MeshSequence) -> list[ShapeKey]:
    """Return the shapes of the sequence's file, in the order of its objects.

    With several runs, the shapes of all runs are returned; objects without vertices are not shapes of the file.
    """
    if len(sequence.runs) == 1:
        return _keys_of(sequence.objects)
    return [*dict.fromkeys(key for run in sequence.runs for key in _keys_of(_with_vertices(run)))]


def _with_vertices(run: MeshSequence) -> list[MeshObject]:
    return [item for item in run.objects if item.vertex_count]


class ShapeWriter(ABC):
    """Writer of one shape.

    Parameters
    ----------
    key : ShapeKey
    title : str
        Title of the format.
    changes : bool
        Whether there are several runs of frames.

    Attributes
    ----------
    item : MeshObject
        The object in this run; one without vertices if the run does not have it.
    drawn : ShapeForm
    normals : NormalRows or None
    in_samples : list of str
        Names of attributes that samples hold.
    notices : list of str
    fields : list of (Field, array)
        The object's fields at the frames that :meth:`write` gets, (frames, rows, components), for the points that the
        object is drawn with.
    """

    def __init__(self, key: ShapeKey, title: str, *, changes: bool) -> None:
        self.key, self.title, self.changes = key, title, changes
        self.notices: list[str] = []
        self.fields: list[tuple[Field, NDArray[Any]]] = []

    def begin(self, item: MeshObject, times: Float64Array) -> None:
        """Begin a run of frames at times [s], in which the shape is this object."""
        self.item = item
        self.drawn = find_shape_form(item.connectivity) if item.vertex_count else ShapeForm(self.key.kind)
        # A subdivision surface has only the normals that follow from it.
        self.normals = None if self.key.subdivision else normal_rows(item)
        self.in_samples = [] if self.normals is None else [NORMAL_GROUP]
        if self.drawn.hidden_lines:
            self.notices.append(
                f"lines of object {item.name!r} show only in pdecodec: {self.title} keeps curves separate"
            )

    def numbered_points(self, most: int) -> Int64Array | None:
        """Return ids of points (vertices,) if there are several runs; they tell whether points of two runs are the
        same.

        They are the object's own ids, unless these are larger than the format can hold (`most`); else they count up
        from 0. None if the shape is not a set of points, or there is only one run.
        """
        if not self.changes or self.key.kind != "points":
            return None
        ids = next((one for one in self.item.attributes if one.name == ID and one.domain == "vertex"), None)
        if ids is None or ids.indices is not None or ids.values.ndim != 1 or ids.values.dtype.kind not in "iu":
            return np.arange(self.item.vertex_count)
        if ids.values.size and not -most <= ids.values.min() <= ids.values.max() <= most:
            return np.arange(self.item.vertex_count)
        self.in_samples.append(ID)
        return ids.values.astype(np.int64)

    def normals_at(self, points: Float32Array) -> Iterator[Float32Array | None]:
        """Yield the normals (rows, 3) at each frame of positions (frames, vertices, 3); None if the shape has none."""
        return iter([None] * len(points)) if self.normals is None else self.normals.of_each(points)

    @abstractmethod
    def write(self, points: Float32Array, speeds: Float32Array | None, times: Float64Array) -> None:
        """Write samples of positions and velocities at times [s], for the points that the object is drawn with."""


_Place = tuple[Any, list[tuple[Field, Any]]]
"""The vertices that a shape is drawn with, and its fields with their rows: slices or indices of the run's."""


def write_shapes(
    sequence: MeshSequence,
    output: Output,
    title: str,
    shapes: Mapping[ShapeKey, ShapeWriter],
    before: Callable[[int], None] = lambda frames: None,
) -> Iterator[Float64Array]:
    """Write samples of all shapes block by block; yield the times [s] of each block after it is written.

    `before` is called with the number of frames of each block before it is written, when shapes have their fields.
    """
    places: dict[ShapeKey, _Place] = {}
    for run, begin, start, block in output.blocks_of_runs(sequence, title, with_fields=True):
        if start == begin:
            of_run = sequence.times[begin : begin + run.frame_count]
            places = _begin_run(shapes, run, of_run, every=len(sequence.runs) == 1)
        times = sequence.times[start : start + len(block)]
        moving = None if output.velocities is None else output.velocities.read_frames(start, start + len(block))
        fields = _fields_of_block(run, start - begin, len(block))
        for key, shape in shapes.items():
            shape.fields = [(field, fields[field.name][:, rows]) for field, rows in places[key][1]]
        before(len(block))
        for key, shape in shapes.items():
            own = places[key][0]
            shape.write(block[:, own], None if moving is None else moving[:, own], times)
        yield times


def _fields_of_block(run: MeshSequence, start: int, frames: int) -> dict[str, NDArray[Any]]:
    """Return the values (frames, rows, components) of each field, by its name, at some frames of a run."""
    return {
        field.name: run.read_field(field.name, start, start + frames).reshape(frames, -1, field.components)
        for field in run.fields
    }


def _begin_run(
    shapes: Mapping[ShapeKey, ShapeWriter], run: MeshSequence, times: Float64Array, *, every: bool
) -> dict[ShapeKey, _Place]:
    """Let all shapes begin a run; return the vertices each is drawn with, and its fields with their rows."""
    owned: list[list[tuple[Field, slice]]] = [[] for _ in run.objects]
    for field in run.fields:
        for own_rows, fields in zip(field.slices(run.objects), owned, strict=True):
            if own_rows.stop > own_rows.start:
                fields.append((field, own_rows))
    objects = run.objects if every else _with_vertices(run)
    owned = [fields for item, fields in zip(run.objects, owned, strict=True) if every or item.vertex_count]
    found = dict(zip(_keys_of(objects), zip(objects, owned, vertex_slices(objects), strict=True), strict=True))
    places: dict[ShapeKey, _Place] = {}
    for key, shape in shapes.items():
        item, fields, own = found.get(key, (MeshObject(key.name, Connectivity(0)), [], slice(0, 0)))
        shape.begin(item, times)
        gather = shape.drawn.gather
        places[key] = (
            own if gather is None else own.start + gather,
            [
                (field, rows if gather is None or field.domain != "vertex" else rows.start + gather)
                for field, rows in fields
            ],
        )
    return places


@dataclass(frozen=True)
class Parameter:
    """An attribute in the form in which a format stores typed parameters.

    Attributes
    ----------
    attribute : Attribute
    role : {"uv", "color", "label", ""}
    values : (n,) or (n, k) array
    indices : (rows of the domain,) int32 or None
    width : int
        Numbers per row.
    """

    attribute: Attribute
    role: str
    values: NDArray[Any]
    indices: Int32Array | None

    @property
    def width(self) -> int:
        return self.values.shape[1] if self.values.ndim == 2 else 1

    @property
    def kind(self) -> tuple[str, int, int]:
        """NumPy's kind of number, its size [bytes], and the numbers per row."""
        return self.values.dtype.kind, self.values.dtype.itemsize, self.width


def write_parameters(
    item: MeshObject,
    drawn: ShapeForm,
    title: str,
    put: Callable[[Parameter], bool],
    written: Sequence[str],
    sets: Sequence[str] = FACE_SETS,
) -> list[str]:
    """Write the attributes that the format stores as parameters; return a notice that names those it cannot store.

    Parameters
    ----------
    item : MeshObject
    drawn : ShapeForm
    title : str
        Title of the format.
    put : callable
        Writes a parameter and returns whether the format has a type for it. Labels are passed as values, rows as their
        indices.
    written : sequence of str
        Names of attributes that the format stores otherwise.
    sets : sequence of str
        Roles of attributes that the format stores as sets of faces.
    """
    lost = []
    for one in item.attributes:
        if one.name in _WRITTEN_ELSEWHERE or one.name in written:
            continue
        if one.domain == "face" and any(is_role(one, role) for role in sets):
            continue
        parameter = Parameter(one, "", one.values, one.indices)
        if any(one is other for other in colors(item)):
            parameter = Parameter(one, COLOR, *_float_rows(one))
        elif any(one is other for other in uv_sets(item)):
            parameter = Parameter(one, UV, *_float_rows(one))
        elif (rows := _label_rows(one)) is not None:
            parameter = Parameter(one, "label", np.array(one.labels), rows)
        if (one.domain in ("face", "corner") and drawn.kind != "mesh") or not put(parameter):
            lost.append(one.name)
    return [f"{title} cannot store attributes: {', '.join(lost)}"] if lost else []


def _label_rows(attribute: Attribute) -> Int32Array | None:
    """Return the label index of each element; None unless every element has one."""
    has_all = attribute.indices is None or (attribute.indices >= 0).all()
    rows = expanded(attribute)
    if not attribute.labels or not has_all or rows.ndim != 1 or not rows.size or rows.min() < 0:
        return None
    return rows.astype(np.int32)


def _float_rows(attribute: Attribute) -> tuple[Float32Array, Int32Array | None]:
    """Return rows as float32, integer colours divided by 255; index -1 still marks elements without a value."""
    values, indices, filled = indexed_rows(attribute)
    return (values[:-1], attribute.indices) if filled else (values, indices)
