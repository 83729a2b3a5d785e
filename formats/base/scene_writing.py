"""What writers of scenes share: names as paths of a tree, sets of faces, attributes as parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.attribute_roles import (
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
    uv_sets,
)
from pdecodec.formats.base.scene_space import TRANSFORM
from pdecodec.formats.base.shape_writing import Drawn
from pdecodec.mesh.arrays import Float32Array, Int32Array
from pdecodec.mesh.sequence import Attribute, MeshObject

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


def named_face_sets(item: MeshObject, valid: Callable[[str], str]) -> Iterator[tuple[str, str, str, Int32Array]]:
    """Role, label, name that no other set of the object has, and members of each set of faces."""
    taken: set[str] = set()
    for role in (GROUP, MATERIAL):
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
