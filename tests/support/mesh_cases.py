"""Meshes for tests of the codec: grids, tubes, and arbitrary connectivity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from hypothesis import strategies as st

from pdecodec.mesh.arrays import Int32Array, Int64Array
from pdecodec.mesh.sequence import Connectivity, MeshObject
from spec.accepted import connectivity as connectivity_of
from spec.decoder.mesh import Mesh


def grid_faces(rows: int, columns: int, *, closed: bool = False) -> Int64Array:
    """Return the quads of a grid, (quads, 4), with vertex ``row * columns + column``; `closed` joins the last
    row to the first.
    """
    row, column = np.meshgrid(np.arange(rows if closed else rows - 1), np.arange(columns - 1), indexing="ij")
    here, below = row * columns, (row + 1) % rows * columns
    return np.stack([here + column, here + column + 1, below + column + 1, below + column], axis=-1).reshape(-1, 4)


def grid(rows: int, columns: int, *, closed: bool = False) -> Connectivity:
    """Return the grid of :func:`grid_faces`: a sheet, or a tube whose rows run lengthwise."""
    return connectivity_of(rows * columns, grid_faces(rows, columns, closed=closed).tolist())


@st.composite
def connectivities(draw: st.DrawFn, most_vertices: int = 12) -> Connectivity:
    """Draw any faces and lines: degenerate, non-manifold, with repeated vertices; many vertices may be unused."""
    vertices = draw(st.integers(1, most_vertices))
    index = st.integers(0, vertices - 1)
    quad = st.lists(index, min_size=4, max_size=4)
    faces = draw(st.lists(quad | st.lists(index, min_size=3, max_size=6), max_size=14))
    lines = draw(st.lists(st.lists(index, min_size=1, max_size=5), max_size=4))
    return connectivity_of(vertices, faces, lines)


@st.composite
def mesh_objects(draw: st.DrawFn) -> list[MeshObject]:
    """Draw one to three objects without attributes."""
    parts = draw(st.lists(connectivities(), min_size=1, max_size=3))
    return [MeshObject(f"object {k}", part) for k, part in enumerate(parts)]


def meshes_of(objects: Sequence[MeshObject]) -> list[Mesh]:
    """Convert objects to the types of the specification's decoder."""

    def split(indices: Int32Array, counts: Int32Array) -> list[list[int]]:
        return [piece.tolist() for piece in np.split(indices, np.cumsum(counts)[:-1])] if counts.size else []

    meshes = []
    for item in objects:
        part = item.connectivity
        faces = split(part.face_indices, part.face_counts)
        meshes.append(Mesh(item.name, item.vertex_count, faces, split(part.line_indices, part.line_counts)))
    return meshes
