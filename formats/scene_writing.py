"""What writers of scenes share: names as paths of a tree, what an object is drawn as, its attributes as parameters."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.attribute_roles import (
    COLOR,
    CURVE_BASIS,
    CURVE_WRAP,
    GROUP,
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
)
from pdecodec.formats.normals import NORMAL_GROUP, normal_rows
from pdecodec.formats.registry import Output
from pdecodec.formats.scene_space import TRANSFORM
from pdecodec.sequence import (
    Attribute,
    Connectivity,
    Float32Array,
    Float64Array,
    Int32Array,
    MeshObject,
    MeshSequence,
)

DEFAULT_NAME = "mesh"
"""Name of an object, or of a step of its path, that has none."""

_WRITTEN_ELSEWHERE = frozenset({SUBDIVISION, CURVE_BASIS, CURVE_WRAP, TRANSFORM})
"""Attributes that say what a shape is, or where."""


def steps_of(name: str) -> tuple[str, ...]:
    """Steps of an object's path."""
    return tuple(step for step in name.split("/") if step)


def tree_paths(
    objects: Sequence[MeshObject], valid: Callable[[str], str] = lambda name: name
) -> tuple[list[tuple[str, ...]], tuple[str, ...]]:
    """Paths of objects from their names, and a line about those that had to change.

    Each path is unlike all others and at least one step long; none is the branch of another. `valid` is what a format
    makes of a step that it cannot hold; itself where it can.
    """
    taken: set[tuple[str, ...]] = set()
    branches: set[tuple[str, ...]] = set()
    paths: list[tuple[str, ...]] = []
    renamed: dict[str, None] = {}
    wanted = [steps_of(item.name) or (DEFAULT_NAME,) for item in objects]
    for steps in wanted:
        branches.update(tuple(map(valid, steps[:length])) for length in range(1, len(steps)))
    for item, steps in zip(objects, wanted, strict=True):
        path = tuple(map(valid, steps))
        number = 1
        while path in taken or path in branches:
            number += 1
            path = (*path[:-1], valid(f"{steps[-1]}_{number}"))
        if "/".join(path) != item.name:
            renamed[f"{item.name!r} as {'/'.join(path)!r}"] = None
        taken.add(path)
        paths.append(path)
    notices = (f"names that had to change: {', '.join(renamed)}",) if renamed else ()
    return paths, notices


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

    kind: Literal["mesh", "curves", "points"]
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


class ShapeWriter(ABC):
    """Writes one object.

    Parameters
    ----------
    item : MeshObject
    title : str
        Of the format.
    """

    def __init__(self, item: MeshObject, title: str) -> None:
        self.item, self.drawn = item, drawn_as(item.connectivity)
        # A subdivision surface has no normals but its own.
        self.normals = None if label_of(item, SUBDIVISION) else normal_rows(item)
        self.in_samples = [] if self.normals is None else [NORMAL_GROUP]
        """Names of attributes that samples hold."""
        self.notices: list[str] = []
        if self.drawn.hidden_lines:
            self.notices.append(f"lines of object {item.name!r} show in pdecodec alone: {title}'s curves are apart")

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
    shapes: Sequence[ShapeWriter],
    before: Callable[[int], None] = lambda frames: None,
) -> Iterator[Float64Array]:
    """Write samples of all shapes block by block; the times [s] of each block, when it is written.

    `before` is called with the number of frames of a block that is about to be written.
    """
    for start, block in output.blocks(sequence, title):
        before(len(block))
        times = sequence.times[start : start + len(block)]
        moving = None if output.velocities is None else output.velocities.read_frames(start, start + len(block))
        first = 0
        for shape in shapes:
            own: Any = slice(first, first + shape.item.vertex_count)
            if shape.drawn.gather is not None:
                own = first + shape.drawn.gather
            shape.write(block[:, own], None if moving is None else moving[:, own], times)
            first += shape.item.vertex_count
        yield times


def named_face_sets(item: MeshObject, valid: Callable[[str], str]) -> Iterator[tuple[str, str, str, Int32Array]]:
    """Role, label, name that no other set of the object has, and members of each set of faces."""
    taken: set[str] = set()
    for role in (GROUP, MATERIAL):
        for label, members in face_sets(item, role):
            name = base = valid(label or role)
            number = 1
            while name in taken:
                number += 1
                name = f"{base}_{number}"
            taken.add(name)
            yield role, label, name, members


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
    item: MeshObject, drawn: Drawn, title: str, put: Callable[[Parameter], bool], written: Sequence[str]
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
    """
    lost = []
    for one in item.attributes:
        if one.name in _WRITTEN_ELSEWHERE or one.name in written:
            continue
        if one.domain == "face" and (is_role(one, GROUP) or is_role(one, MATERIAL)):
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
