"""Meshes for scenes (grid, tube, lattice of tetrahedra), and the topology that constraints need."""

from __future__ import annotations

import numpy as np

from pdecodec.mesh.arrays import Int32Array


def grid_quads(columns: int, rows: int) -> Int32Array:
    """Return quads of a grid, (quads, 4) int32: vertex ``row * columns + column``, counter-clockwise for x
    along columns.
    """
    vertex = np.arange(columns * rows, dtype=np.int32).reshape(rows, columns)
    quads = np.stack([vertex[:-1, :-1], vertex[:-1, 1:], vertex[1:, 1:], vertex[1:, :-1]], axis=-1)
    return quads.reshape(-1, 4)


def tube_quads(curves: Int32Array) -> Int32Array:
    """Return quads of an open tube, (sides * (rings - 1), 4) int32.

    They face outwards where the curves run counter-clockwise for an eye that looks back along them.

    Parameters
    ----------
    curves : (sides, rings) int32
        Vertices of the lengthwise curves, which follow each other around the tube.
    """
    following = np.roll(curves, -1, axis=0)
    quads = np.stack([curves[:, :-1], following[:, :-1], following[:, 1:], curves[:, 1:]], axis=-1)
    return quads.reshape(-1, 4)


def triangulate(quads: Int32Array) -> Int32Array:
    """Split each quad into two triangles, with diagonals alternating so that no direction is stiffer."""
    first = np.stack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1)
    second = np.stack([quads[:, [0, 1, 3]], quads[:, [1, 2, 3]]], axis=1)
    odd = np.arange(len(quads)) % 2 == 1
    return np.where(odd[:, None, None], second, first).reshape(-1, 3)


def tetrahedron_edges(tetrahedra: Int32Array) -> Int32Array:
    """Return each edge of tetrahedra, (tetrahedra, 4) int32, once and sorted: (edges, 2) int32."""
    pairs = np.concatenate([tetrahedra[:, [a, b]] for b in range(4) for a in range(b)])
    edges: Int32Array = np.unique(np.sort(pairs, axis=1), axis=0)
    return edges


def bending_stencils(triangles: Int32Array) -> Int32Array:
    """Return pairs of triangles that share an edge.

    Parameters
    ----------
    triangles : (triangles, 3) int32
        An edge belongs to two triangles at most.

    Returns
    -------
    (inner edges, 4) int32
        The edge's ends, then the corner opposite to it in either triangle; sorted by edge.
    """
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    opposite = np.concatenate([triangles[:, 2], triangles[:, 0], triangles[:, 1]])
    edges = np.sort(edges, axis=1)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, opposite = edges[order], opposite[order]
    shared = np.flatnonzero((edges[1:] == edges[:-1]).all(axis=1))
    return np.column_stack([edges[shared], opposite[shared], opposite[shared + 1]])


def lattice_tetrahedra(cells: int) -> Int32Array:
    """Return five tetrahedra in each cube of a ``cells^3`` lattice, mirrored from cube to cube so that faces
    match.

    Vertex ``(i, j, k)`` along x, y, z has the number ``(i * (cells + 1) + j) * (cells + 1) + k``.

    Returns
    -------
    (5 * cells**3, 4) int32
        Positively oriented.
    """
    size = cells + 1
    i, j, k = (axis.ravel() for axis in np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"))
    odd = ((i + j + k) % 2).astype(bool)

    def corner(dx: int, dy: int, dz: int) -> Int32Array:
        mirrored = np.where(odd, 1 - dx, dx)  # odd cubes are mirrored along x
        return (((i + mirrored) * size + j + dy) * size + k + dz).astype(np.int32)

    parts = [
        ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)),
        ((1, 1, 0), (0, 1, 0), (1, 0, 0), (1, 1, 1)),
        ((1, 0, 1), (0, 0, 1), (1, 1, 1), (1, 0, 0)),
        ((0, 1, 1), (0, 1, 0), (1, 1, 1), (0, 0, 1)),
        ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)),
    ]
    tetrahedra = np.stack([np.stack([corner(*offset) for offset in part], axis=1) for part in parts], axis=1)
    tetrahedra[odd] = tetrahedra[odd][:, :, [0, 2, 1, 3]]  # mirroring reverses the orientation
    return tetrahedra.reshape(-1, 4)


def lattice_surface(cells: int) -> Int32Array:
    """Return quads on the six sides of a ``cells^3`` lattice, (6 * cells**2, 4) int32, outwards, with its
    vertex numbers.
    """
    vertex = np.arange((cells + 1) ** 3, dtype=np.int32).reshape(cells + 1, cells + 1, cells + 1)
    sides = []
    for axis in range(3):
        for end in (0, -1):
            # In cyclic order of axes, rows and columns span a side whose normal is +axis.
            side = np.moveaxis(vertex, [(axis + 1) % 3, (axis + 2) % 3], [0, 1])[..., end]
            quads = np.stack([side[:-1, :-1], side[1:, :-1], side[1:, 1:], side[:-1, 1:]], axis=-1).reshape(-1, 4)
            sides.append(quads if end == -1 else quads[:, ::-1])
    return np.concatenate(sides)
