"""Space bases: orthonormal functions of the rest shape on patches, joined upwards over the whole mesh.

A mesh is divided into patches: by halving its graph again and again (basis "patch"), or along the pieces of its
curves (basis "curve"). On each patch stand orthonormal functions: the affine four ``1, x, y, z`` first (what the
literal Eq. 23 amounts to once its matrices are data), then polynomials of the rest shape's local coordinates by
total degree, or the eight functions of Eqs. 14 and 16 along a curve piece, then unit vectors until the space of
the patch is complete or the basis has as many functions as it may.

What the affine functions of two neighbouring patches have in common, they share: those of a set are an orthogonal
combination of those of its halves, and only the *details* (the rest of the combinations) stay with the set. A limb
that moves as one needs four numbers, however many patches it has. (Alpert 1993, "A class of bases in L2 for the
sparse representation of integral operators": multiwavelets, here on the vertices of a mesh.)
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pdecodec.basis import SPACE_FUNCTIONS, series_functions
from pdecodec.curves import extract_curves, order_lonely_points
from pdecodec.elements import PIECE_POINTS, arc_length_parameter, piece_starts
from pdecodec.patches import Patches, build_patches
from pdecodec.sequence import MeshObject
from pdecodec.shares import in_shares

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]
Int32Array = NDArray[np.int32]

SpaceKind = Literal["patch", "curve"]

SPACE_KINDS: tuple[SpaceKind, ...] = ("patch", "curve")
"""By their number in the file."""

MOST_POINTS = 256
"""Vertices of a patch at most."""

NORMAL_DEGREE = 2
"""What a factor of the third principal coordinate counts in a polynomial's degree: across a surface there is less
to describe than along it."""

LARGEST_DEGREE = 10
"""Of the polynomials; what comes after them is left to unit vectors."""

MOST_FUNCTIONS = 128
"""Functions of a patch at most: building them costs the square of their number."""


@lru_cache
def polynomial_exponents() -> Int64Array:
    """(n, 3) int64: exponents of the polynomials in order; the affine four, then by degree.

    The third coordinate counts twice, but for the affine four. Equal degrees: higher powers of the first
    coordinate first, then of the second.
    """
    found = [
        (a, b, c)
        for a in range(LARGEST_DEGREE + 1)
        for b in range(LARGEST_DEGREE + 1 - a)
        for c in range((LARGEST_DEGREE - a - b) // NORMAL_DEGREE + 1)
    ]
    affine = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    rest = [item for item in found if item not in affine]
    rest.sort(key=lambda item: (item[0] + item[1] + NORMAL_DEGREE * item[2], -item[0], -item[1]))
    return np.array(affine + rest, np.int64)


@lru_cache
def polynomial_table() -> Int64Array:
    """(n, 4) int64: how each polynomial is made of those before it.

    In the columns of the axes, which polynomial has a degree less on that axis, -1 for none; then along which axis it
    is made of that one, the first that it can be, -1 for the constant.
    """
    exponents = [tuple(row) for row in polynomial_exponents().tolist()]
    place = {item: j for j, item in enumerate(exponents)}
    table = np.full((len(exponents), 4), -1, np.int64)
    for j, item in enumerate(exponents):
        for axis in reversed(range(3)):
            if item[axis]:
                table[j, axis] = place[tuple(degree - (k == axis) for k, degree in enumerate(item))]
                table[j, 3] = axis
    return table


@dataclass(frozen=True, eq=False)
class SpaceBasis:
    """Patches, their functions, and how they are joined.

    Attributes
    ----------
    order : (vertices,) int32
        Vertices of the mesh in patch order.
    starts : (patches + 1,) int64
        Patch p holds ``order[starts[p]:starts[p + 1]]``.
    levels : (vertices, 3) int64
        Rest shape in quantisation steps, which the functions are made of.
    given : (vertices, m) float64
        Functions of curve pieces before they are made orthonormal, in patch order; m = 0 under "patch".
    affine : (patches,) int64
        How many of a patch's functions are affine: these come first.
    children : (sets,) int64
        Sets of patches; 0 is the whole. First of the two halves of each, the second follows it; -1 for a patch.
    counts : (sets,) int64
        Affine functions of each set.
    joints : (sets, 8, 8) float64
        Orthogonal: a set's affine functions and details from its halves' affine functions.
    set_of : (patches,) int64
        The set that each patch is.
    detail_starts : (sets,) int64
        Where each set's details begin among the columns; the whole's affine functions are the first columns.
    coefficient_starts : (patches + 1,) int64
        Where the columns of each patch begin, after all details.
    """

    order: Int32Array
    starts: Int64Array
    levels: Int64Array
    given: Float64Array
    affine: Int64Array
    children: Int64Array
    counts: Int64Array
    joints: Float64Array
    set_of: Int64Array
    detail_starts: Int64Array
    coefficient_starts: Int64Array

    @property
    def columns(self) -> int:
        """Functions altogether."""
        return int(self.coefficient_starts[-1])

    @property
    def patches(self) -> int:
        return self.starts.size - 1

    @property
    def runs(self) -> int:
        """Runs of columns: one of the whole's affine functions, one of each set that is no patch, one of each patch."""
        return 1 + self.children.size

    @cached_property
    def largest(self) -> int:
        """Vertices of the largest patch."""
        return int(np.diff(self.starts).max(initial=0))

    @cached_property
    def units(self) -> tuple[Int64Array, Int64Array, Int64Array]:
        """Columns in runs, as they are coded: ``(starts, kinds, parents)``.

        Run 0 is the whole's affine functions, then come the details of each set, then each patch's other
        functions. ``kinds`` is a set's depth (0 for run 0), or -1 - affine for a patch; ``parents`` the run of the
        set above.
        """
        inner = np.flatnonzero(self.children >= 0)
        depth = np.zeros(self.children.size, np.int64)
        above = np.zeros(self.children.size, np.int64)
        run = np.zeros(self.children.size, np.int64)
        run[inner] = 1 + np.arange(inner.size)
        for s in inner:
            for half in (self.children[s], self.children[s] + 1):
                depth[half], above[half] = depth[s] + 1, run[s]
        starts = np.concatenate([[0], self.detail_starts[inner], self.coefficient_starts])
        kinds = np.concatenate([[0], depth[inner] + 1, -1 - self.affine])
        parents = np.concatenate([[0], above[inner], above[self.set_of]])
        return starts.astype(np.int64), kinds.astype(np.int64), parents.astype(np.int64)

    @cached_property
    def _complete(self) -> tuple[Float64Array, Int64Array]:
        """All functions of each patch: ``(basis, basis_starts)``, function after function."""
        from pdecodec.kernels.patch_functions import build_patches, new_scratch

        ranks = self.affine + np.diff(self.coefficient_starts)
        basis_starts = np.concatenate([[0], np.cumsum(ranks * np.diff(self.starts))])
        basis = np.empty(int(basis_starts[-1]))
        table = polynomial_table()

        def build(first: int, end: int) -> None:
            build_patches(
                first, end, self.levels, self.order, self.starts, table, self.given, ranks, basis, basis_starts,
                new_scratch(self.largest, len(table)),
            )  # fmt: skip

        in_shares(build, self.patches)
        return basis, basis_starts

    @property
    def functions_made(self) -> tuple[Float64Array, Int64Array]:
        """All functions of each patch as an encoder has made them; of none in a decoder, which makes those it needs."""
        made: tuple[Float64Array, Int64Array] = self.__dict__.get("_complete", (np.zeros(0), np.zeros(0, np.int64)))
        return made

    def project(self, values: Float64Array) -> Float64Array:
        """Coefficients of functions on the vertices: (vertices, width), mesh order, to (columns, width) float64."""
        from pdecodec.kernels.space_transform import join, project_patches

        width = values.shape[1]
        scaling = np.zeros((self.children.size, 4, width))
        coefficients = np.zeros((self.columns, width))
        ordered = np.ascontiguousarray(values[self.order], dtype=np.float64)
        basis, basis_starts = self._complete

        def project(first: int, end: int) -> None:
            project_patches(
                first, end, ordered, self.starts, basis, basis_starts, self.affine, self.coefficient_starts,
                scaling, self.set_of, coefficients,
            )  # fmt: skip

        in_shares(project, self.patches)
        join(self.children, self.counts, self.joints, self.detail_starts, scaling, coefficients)
        return coefficients


def build_space_basis(
    kind: SpaceKind,
    objects: Sequence[MeshObject],
    rest: Int64Array,
    *,
    points: int,
    functions: int,
    early: Patches | None = None,
) -> SpaceBasis:
    """The space basis of a mesh.

    Parameters
    ----------
    kind : {"patch", "curve"}
    objects : sequence of MeshObject
    rest : (vertices, 3) int64
        Rest shape in quantisation steps.
    points : int
        Vertices of a patch at most.
    functions : int
        Functions of a patch at most.
    early : Patches, optional
        What `pdecodec.patches.early_patches` gave; made again where the rest shape changes them.
    """
    if kind == "patch":
        patches = build_patches(objects, rest, points, early)
        given = np.zeros((0, 0))
    else:
        patches, given = _pieces(objects, rest, points)
    return _with_functions(patches, given, rest, functions)


def _with_functions(patches: Patches, given: Float64Array, rest: Int64Array, functions: int) -> SpaceBasis:
    from pdecodec.kernels.patch_functions import AFFINE, affine_functions, build_joints, new_scratch

    table = polynomial_table()
    order, starts, children, set_of = patches.order, patches.starts, patches.children, patches.set_of
    sizes = np.diff(starts)
    affine, patch_coordinates = np.zeros(sizes.size, np.int64), np.zeros((sizes.size, AFFINE, AFFINE))
    scratch = new_scratch(int(sizes.max(initial=0)), len(table))
    affine_functions(rest, order, starts, table, given, functions, affine, patch_coordinates, scratch)
    # Unit vectors complete whatever polynomials leave open.
    ranks = np.minimum(sizes, functions)
    counts = np.zeros(children.size, np.int64)
    coordinates = np.zeros((children.size, AFFINE, AFFINE))
    counts[set_of], coordinates[set_of] = affine, patch_coordinates
    joints = np.zeros((children.size, 2 * AFFINE, 2 * AFFINE))
    scratch = new_scratch(2 * AFFINE, 0)
    build_joints(children, counts, coordinates, joints, np.empty((2 * AFFINE, AFFINE)), scratch)
    inner = np.flatnonzero(children >= 0)
    details = np.zeros(children.size, np.int64)
    details[inner] = counts[children[inner]] + counts[children[inner] + 1] - counts[inner]
    detail_starts = counts[0] + np.cumsum(details) - details
    first = counts[0] + details.sum()
    coefficient_starts = first + np.concatenate([[0], np.cumsum(ranks - affine)])
    return SpaceBasis(
        order=order,
        starts=starts,
        levels=rest,
        given=given,
        affine=affine,
        children=children,
        counts=counts,
        joints=joints,
        set_of=set_of,
        detail_starts=detail_starts.astype(np.int64),
        coefficient_starts=coefficient_starts.astype(np.int64),
    )


def _pieces(objects: Sequence[MeshObject], rest: Int64Array, points: int) -> tuple[Patches, Float64Array]:
    """Pieces of curves, and their functions before orthonormalisation."""
    curves = order_lonely_points(extract_curves(objects), rest)
    level = int(np.searchsorted(PIECE_POINTS, points))
    starts, _ = piece_starts(curves, np.full(curves.count, level))
    along = rest[curves.order].astype(np.float64)
    local = along - np.repeat(along[starts[:-1]], np.diff(starts), axis=0)
    shape = series_functions(arc_length_parameter(local, starts), 0.0, SPACE_FUNCTIONS)
    children, set_of = _chain(starts.size - 1)
    given = np.column_stack([np.ones(len(local)), local, shape])
    return Patches(curves.order, starts, children, set_of), given


def _chain(patches: int) -> tuple[Int64Array, Int64Array]:
    """Sets over patches in a row, halved again and again: ``(children, set_of)``."""
    begins, ends, children = [0], [patches], []
    for s in itertools.count():
        if s == len(begins):
            break
        if ends[s] - begins[s] == 1:
            children.append(-1)
            continue
        children.append(len(begins))
        middle = (begins[s] + ends[s]) // 2
        begins += [begins[s], middle]
        ends += [middle, ends[s]]
    found = np.array(children, np.int64)
    leaves = np.flatnonzero(found < 0)
    return found, leaves[np.argsort(np.array(begins)[leaves])]
