"""Objects in a tree, for formats that have one: paths out of names, and what an object is drawn as."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pdecodec.sequence import Connectivity, Int32Array, MeshObject

DEFAULT_NAME = "mesh"
"""Name of an object, or of a step of its path, that has none."""


@dataclass(frozen=True)
class TreePaths:
    """Paths of objects, and what was changed to make them such.

    Attributes
    ----------
    paths : tuple of tuple of str
        Each unlike all others and at least one step long; none is the branch of another.
    notices : tuple of str
    """

    paths: tuple[tuple[str, ...], ...]
    notices: tuple[str, ...]


def tree_paths(objects: Sequence[MeshObject], valid: Callable[[str], str] = lambda name: name) -> TreePaths:
    """Paths of objects from their names, which have slashes between steps.

    Parameters
    ----------
    objects : sequence of MeshObject
    valid : callable
        What a format makes of a step that it cannot hold; itself where it can.
    """
    taken: set[tuple[str, ...]] = set()
    branches: set[tuple[str, ...]] = set()
    paths: list[tuple[str, ...]] = []
    renamed: dict[str, None] = {}
    wanted = [tuple(step for step in item.name.split("/") if step) or (DEFAULT_NAME,) for item in objects]
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
    return TreePaths(tuple(paths), notices)


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
