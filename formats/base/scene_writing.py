"""What writers of scenes share: names as paths of a tree, shapes and their samples, attributes as parameters.

A file has one shape for an object in all runs of frames. In runs that do not have the object the shape is empty.
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
    uv_sets,
    vertex_slices,
)
from pdecodec.formats.base.normals import NORMAL_GROUP, normal_rows
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.scene_space import TRANSFORM
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.mesh.sequence import Attribute, Connectivity, MeshObject, MeshSequence

DEFAULT_NAME = "mesh"
"""Name of an object, or of a step of its path, that has none."""

_WRITTEN_ELSEWHERE = frozenset({SUBDIVISION, CURVE_BASIS, CURVE_WRAP, TRANSFORM})
"""Attributes that say what a shape is, or where."""


def steps_of(name: str) -> tuple[str, ...]:
    """Steps of an object's path."""
    return tuple(step for step in name.split("/") if step)


def tree_paths(
    names: Sequence[str], valid: Callable[[str], str] = lambda name: name
) -> tuple[list[tuple[str, ...]], tuple[str, ...]]:
    """Paths of objects from their names, and a line about those that had to change.

    Each path is unlike all others and at least one step long; none is the branch of another. `valid` is what a format
    makes of a step that it cannot hold; itself where it can.
    """
    taken: set[tuple[str, ...]] = set()
    branches: set[tuple[str, ...]] = set()
    paths: list[tuple[str, ...]] = []
    wanted = [steps_of(name) or (DEFAULT_NAME,) for name in names]
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
    """Return the line about names that had to change, of pairs of a name and what it became; none where none had to."""
    changes = ", ".join(dict.fromkeys(f"{name!r} as {found!r}" for name, found in pairs if name != found))
    return (f"names that had to change: {changes}",) if changes else ()


FACE_SETS = (GROUP, MATERIAL)
"""Roles of attributes that name sets of faces."""


def named_face_sets(
    item: MeshObject, valid: Callable[[str], str], roles: Sequence[str] = FACE_SETS
) -> Iterator[tuple[str, str, str, Int32Array]]:
    """Role, label, name that no other set of the object has, and members of each set of faces of some roles."""
    taken: set[str] = set()
    for role in roles:
        for label, members in face_sets(item, role):
            yield role, label, unlike(valid(label or role), taken), members


def unlike(name: str, taken: set[str]) -> str:
    """A name that is not taken yet, which then is: itself, or with a number behind it."""
    found, number = name, 1
    while found in taken:
        number += 1
        found = f"{name}_{number}"
    taken.add(found)
    return found


Kind = Literal["mesh", "curves", "points"]


@dataclass(frozen=True)
class Drawn:
    """What an object is in formats where meshes, curves and points are things apart.

    Attributes
    ----------
    kind : {"mesh", "curves", "points"}
        Faces; lines alone, every vertex in one; else points.
    gather : (line points,) int32 or None
        Vertex of each point of its curves, where that is not all of them in order.
    hidden_lines : bool
        Whether it has lines that do not show: beside faces, or beside vertices that no line has.
    """

    kind: Kind
    gather: Int32Array | None = None
    hidden_lines: bool = False


def drawn_as(connectivity: Connectivity) -> Drawn:
    """What an object of this connectivity is drawn as."""
    if connectivity.face_count:
        return Drawn("mesh", hidden_lines=connectivity.line_count > 0)
    if not connectivity.line_count:
        return Drawn("points")
    indices = connectivity.line_indices
    if connectivity.line_counts.min() < 2 or np.unique(indices).size < connectivity.vertex_count:
        return Drawn("points", hidden_lines=True)
    in_order = np.array_equal(indices, np.arange(connectivity.vertex_count))
    return Drawn("curves", gather=None if in_order else indices)


@dataclass(frozen=True)
class ShapeKey:
    """What objects of several runs of frames have alike that are one shape.

    Attributes
    ----------
    name : str
    number : int
        From 0, of objects of one run that have the rest alike.
    kind : {"mesh", "curves", "points"}
    subdivision, curve_basis, curve_wrap : str or None
        Labels that formats have once for a shape.
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
        first = ShapeKey(item.name, 0, drawn_as(item.connectivity).kind, subdivision, basis, wrap)
        keys.append(dataclasses.replace(first, number=counts[first]))
        counts[first] += 1
    return keys


def shape_keys(sequence: MeshSequence) -> list[ShapeKey]:
    """The shapes of a file of the sequence, in the order of its objects.

    Of several runs each is looked at; objects without vertices are no shapes there.
    """
    if len(sequence.runs) == 1:
        return _keys_of(sequence.objects)
    return [*dict.fromkeys(key for run in sequence.runs for key in _keys_of(_there(run)))]


def _there(run: MeshSequence) -> list[MeshObject]:
    return [item for item in run.objects if item.vertex_count]


class ShapeWriter(ABC):
    """Writes one shape.

    Parameters
    ----------
    key : ShapeKey
    title : str
        Of the format.
    changes : bool
        Whether there are several runs of frames.

    Attributes
    ----------
    item : MeshObject
        The object of this run; one without vertices where the run has none.
    drawn : Drawn
    normals : NormalRows or None
    in_samples : list of str
        Names of attributes that samples hold.
    notices : list of str
    """

    def __init__(self, key: ShapeKey, title: str, *, changes: bool) -> None:
        self.key, self.title, self.changes = key, title, changes
        self.notices: list[str] = []

    def begin(self, item: MeshObject, times: Float64Array) -> None:
        """Go on to a run of frames at times [s], in which the object is this one."""
        self.item = item
        self.drawn = drawn_as(item.connectivity) if item.vertex_count else Drawn(self.key.kind)
        # A subdivision surface has no normals but its own.
        self.normals = None if self.key.subdivision else normal_rows(item)
        self.in_samples = [] if self.normals is None else [NORMAL_GROUP]
        if self.drawn.hidden_lines:
            self.notices.append(
                f"lines of object {item.name!r} show in pdecodec alone: {self.title}'s curves are apart"
            )

    def numbered_points(self, most: int) -> Int64Array | None:
        """Where there are several runs, (vertices,) ids of points, which tell those of one run from those of the next.

        They are those of the object, unless they are larger than the format can hold; else they count up from 0. None
        where this is no set of points, or there is one run.
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
        """Rows of normals (rows, 3) at each of some positions (frames, vertices, 3); None where there are none."""
        return iter([None] * len(points)) if self.normals is None else self.normals.of_each(points)

    @abstractmethod
    def write(self, points: Float32Array, speeds: Float32Array | None, times: Float64Array) -> None:
        """Write samples of positions, and of velocities, at times [s], for the points that the object is drawn with."""


def write_shapes(
    sequence: MeshSequence,
    output: Output,
    title: str,
    shapes: Mapping[ShapeKey, ShapeWriter],
    before: Callable[[int], None] = lambda frames: None,
) -> Iterator[Float64Array]:
    """Write samples of all shapes block by block; the times [s] of each block, when it is written.

    `before` is called with the number of frames of a block that is about to be written.
    """
    places: dict[ShapeKey, Any] = {}
    for run, begin, start, block in output.blocks_of_runs(sequence, title):
        if start == begin:
            of_run = sequence.times[begin : begin + run.frame_count]
            places = _begin_run(shapes, run, of_run, every=len(sequence.runs) == 1)
        before(len(block))
        times = sequence.times[start : start + len(block)]
        moving = None if output.velocities is None else output.velocities.read_frames(start, start + len(block))
        for key, shape in shapes.items():
            own = places.get(key, slice(0))
            shape.write(block[:, own], None if moving is None else moving[:, own], times)
        yield times


def _begin_run(
    shapes: Mapping[ShapeKey, ShapeWriter], run: MeshSequence, times: Float64Array, *, every: bool
) -> dict[ShapeKey, Any]:
    """Let shapes go on to a run; which of its vertices each of them is drawn with."""
    objects = run.objects if every else _there(run)
    found = dict(zip(_keys_of(objects), zip(objects, vertex_slices(objects), strict=True), strict=True))
    places: dict[ShapeKey, Any] = {}
    for key, shape in shapes.items():
        item, own = found.get(key, (MeshObject(key.name, Connectivity(0)), slice(0, 0)))
        shape.begin(item, times)
        places[key] = own if shape.drawn.gather is None else own.start + shape.drawn.gather
    return places


@dataclass(frozen=True)
class Parameter:
    """An attribute as a format with typed parameters takes it.

    Attributes
    ----------
    attribute : Attribute
    role : {"uv", "color", "label", ""}
    values : (n,) or (n, k) array
    indices : (rows of the domain,) int32 or None
    width : int
        Numbers in a row.
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
        """NumPy's kind of number, its bytes, and the numbers in a row."""
        return self.values.dtype.kind, self.values.dtype.itemsize, self.width


def write_parameters(
    item: MeshObject,
    drawn: Drawn,
    title: str,
    put: Callable[[Parameter], bool],
    written: Sequence[str],
    sets: Sequence[str] = FACE_SETS,
) -> list[str]:
    """Put what has no place of its own in a format; a line that names what it has no place for.

    Parameters
    ----------
    item : MeshObject
    drawn : Drawn
    title : str
        Of the format.
    put : callable
        Writes a parameter; whether there was a type for it. Labels are values of their own, and rows their indices.
    written : sequence of str
        Names of attributes that have a place of their own.
    sets : sequence of str
        Roles of attributes that are sets of faces there.
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
    return [f"{title} has no place for attributes: {', '.join(lost)}"] if lost else []


def _label_rows(attribute: Attribute) -> Int32Array | None:
    """The label of each element; None unless every element has one."""
    has_all = attribute.indices is None or (attribute.indices >= 0).all()
    rows = expanded(attribute)
    if not attribute.labels or not has_all or rows.ndim != 1 or not rows.size or rows.min() < 0:
        return None
    return rows.astype(np.int32)


def _float_rows(attribute: Attribute) -> tuple[Float32Array, Int32Array | None]:
    """Rows as float32, of integer colours over 255; indices keep -1 for none."""
    values, indices, filled = indexed_rows(attribute)
    return (values[:-1], attribute.indices) if filled else (values, indices)
