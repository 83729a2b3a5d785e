"""Solids for tests: blocks of finite elements that bend, with a field on their cells and one on their nodes."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from pdecodec import ArraySequence, Attribute, ChangingSequence, Connectivity, Field, MeshObject
from pdecodec.formats.vtk.cells import BLOCK, Cells
from spec.decoder.cells import EDGES

TETRAHEDRA = [[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]]
WEDGES = [[0, 1, 3, 4, 5, 7], [1, 2, 3, 5, 6, 7]]
PYRAMIDS = [[0, 3, 2, 1, 8], [4, 5, 6, 7, 8], [0, 1, 5, 4, 8], [1, 2, 6, 5, 8], [2, 3, 7, 6, 8], [3, 0, 4, 7, 8]]
PARTS = {"tetra": TETRAHEDRA, "pyramid": PYRAMIDS, "wedge": WEDGES, "hexahedron": [[*range(8)]]}
CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))


def elements(kind: str, size: int, *, quadratic: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return points (nodes, 3) and cells (cells, nodes) of a cube of `size` hexahedra per side, divided into
    cells of a kind.
    """
    points: dict[tuple[float, ...], int] = {}

    def node(place: np.ndarray) -> int:
        return points.setdefault(tuple(np.round(place, 6).tolist()), len(points))

    rows = []
    for low in product(range(size), repeat=3):
        corners = np.array([*CORNERS, (0.5, 0.5, 0.5)]) + low
        for part in PARTS[kind]:
            places = corners[part]
            if quadratic:
                solid = list(PARTS).index(kind)
                middles = [places[[int(edge[0]), int(edge[1])]].mean(axis=0) for edge in EDGES[solid]]
                places = np.array([*places, *middles])
            rows.append([node(place) for place in places])
    return np.array([*points]), np.array(rows)


def solid_sequence(*kinds: str, size: int = 2, frames: int = 4, quadratic: bool = False) -> ArraySequence:
    """Return one object of several kinds of solids in a row, with two triangles and a line on top of the last solid."""
    cells, points, first = Cells(vtk=True, solids="keep"), list[np.ndarray](), 0
    labels = []
    for number, kind in enumerate(kinds):
        own, rows = elements(kind, size, quadratic=quadratic)
        cells.add(kind, rows + first)
        labels += [number] * len(rows)
        points.append(own + np.array([2.0 * size * number, 0, 0]))
        first += len(own)
    cells.add("triangle", np.array([[0, 1, 2], [1, 2, 3]]))
    cells.add("line", np.array([[0, 5]]))
    labels += [len(kinds)] * 3
    rest = np.concatenate(points)
    connectivity, _ = cells.connectivity(rest)
    times = np.arange(frames) / 24
    moving = rest + 0.2 * np.sin(rest[:, [2, 0, 1]] + 40 * times[:, None, None])
    block = Attribute(BLOCK, "cell", np.array(labels, np.int32), labels=(*kinds, "shells"))
    stress = np.sin(np.arange(len(labels)) / 9 + 30 * times[:, None]).astype(np.float32)
    heat = moving[..., :2].astype(np.float32) ** 2
    return ArraySequence(
        moving,
        objects=[MeshObject("mesh", connectivity, (block,))],
        times=times,
        fields=[(Field("stress", "cell"), stress), (Field("heat", "vertex", components=2), heat)],
    )


def runs_with_cells() -> ChangingSequence:
    """Return four runs of two frames: two with equal cells, one with more, and one without faces and cells."""
    small, large = solid_sequence("tetra", size=1, frames=2), solid_sequence("tetra", size=2, frames=2)
    points_only = replace(small.objects[0], connectivity=Connectivity(small.vertex_count), attributes=())
    runs: list[Any] = [small, small, large, ArraySequence(small.points, objects=[points_only])]
    vertices = [one.vertex_count for one in runs]
    return ChangingSequence(runs, times=np.arange(8) / 24, frames=[2] * 4, vertices=vertices, fps=24)
