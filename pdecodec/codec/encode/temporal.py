"""Displacements of a group of frames before quantisation, and the functions of time that represent them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, Literal

import numpy as np

from pdecodec import _core
from pdecodec.codec.encode.tuning import Tuning
from pdecodec.codec.linear_algebra import (
    Span,
    leading_span,
    principal_axes,
    principal_axes_within,
    principal_trajectories,
    product,
    products,
    pseudo_inverse,
    spanning,
    sums_of_squares,
    with_more,
)
from pdecodec.codec.sections.groups import TimeBasis, cosines
from pdecodec.codec.sections.space_basis import Rows
from pdecodec.codec.sections.time_functions import TimeFunctionCost
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.system.shares import thread_count

Origin = Literal["reference", "first"]
ORIGINS: tuple[Origin, ...] = ("reference", "first")
"""Origins of displacements: the decoded reference frame, or frame 0 as it was read. The latter excludes the
error of the reference frame, which is the same in every frame, so vertices at rest cost nothing.
"""

TimeFunctions = Literal["trajectories", "shapes", "poses", "cosines"]
TIME_FUNCTIONS: tuple[TimeFunctions, ...] = ("trajectories", "shapes", "poses", "cosines")
"""Principal trajectories; principal functions that all axes share; weights of a few of the group's own frames;
cosines. Poses separate blend shapes and keyframes, which principal functions mix; a file stores them as shapes.
"""

FARTHEST_STEPS = 2.0**26
"""Displacements beyond this many bounds are not fitted as motion but left to residuals."""

SINGLE_ROWS = 2.0**-12
"""Displacements and their products are kept in float32 if the bound is at least this share of the largest
displacement. With half of this, robots that turn round take 0.6 % more bytes.
"""

LARGEST_SINGLE = 2.0**40
"""Largest displacement kept in float32: sums of squares of larger ones may leave its range."""

ALIKE = 1e-2
"""Eigenvalue, relative to the largest, below which functions of a fit count as equal."""

ROUNDING = 1e-14
"""Eigenvalue of the poses' products, relative to the largest, that is only rounding."""


def time_basis_of(functions: TimeFunctions) -> TimeBasis:
    """Return the time basis under which a file stores functions of time."""
    return "shapes" if functions == "poses" else functions


Seen = Literal["moved", "span", "shift"]
"""Arrays that a projection is applied to: displacements, their coefficients in a span, and the difference of
two shapes that displacements are measured from.
"""


class Sight:
    """Linear map of vertices, applied once to displacements and then used for all functions of time.

    Parameters
    ----------
    project : callable
        Takes values on vertices, (vertices, n) float32 or float64, and returns (rows, n).
    """

    def __init__(self, project: Callable[[Rows], Rows]) -> None:
        self._project = project
        self._seen: dict[tuple[Displacements, Seen], Rows] = {}

    def of(self, owner: Displacements, name: Seen) -> Rows:
        """Return the projection of an array of `owner`."""
        if (owner, name) not in self._seen:
            self._seen[owner, name] = self._project(owner.values(name))
        return self._seen[owner, name]


class Displacements:
    """Positions of a group minus one shape, and their principal functions, each computed when first needed.

    Parameters
    ----------
    points : (frames, vertices, 3) float32 [scene units]
    shape : (vertices, 3) float64 [scene units]
    unit : float [scene units]
        The bound, or the spacing of float32 where that is larger.
    tuning : Tuning
    alike : Displacements, optional
        Displacements of the same points from nearly the same shape; their functions of time are used here, too.
    sibling : Displacements, optional
        Displacements of the same points from another shape; their sums of squares give those of these.
    part_of : (Displacements, slice), optional
        Displacements of more frames from the same shape, and which of those frames these are. Results are taken from
        them until these are released.
    """

    def __init__(
        self,
        points: Float32Array,
        shape: Float64Array,
        unit: float,
        tuning: Tuning,
        *,
        alike: Displacements | None = None,
        sibling: Displacements | None = None,
        part_of: tuple[Displacements, slice] | None = None,
    ) -> None:
        self._points, self._shape, self._unit = points, np.ascontiguousarray(shape), unit
        self._tuning = tuning
        self._alike, self._sibling = alike, sibling
        self._part_of = part_of if part_of and part_of[0]._span is None and not part_of[0]._is_wide else None
        self._frames, self._vertices = len(points), len(shape)
        self._least = (tuning.tail * unit) ** 2 * self._vertices * self._frames
        self._taken: tuple[Rows, float] | None = None
        self._coefficients: dict[TimeFunctions, Rows] = {}
        self._settled: dict[TimeFunctions, tuple[Float64Array, Float64Array]] = {}
        self._time_costs: dict[TimeFunctions, TimeFunctionCost] = {}

    @property
    def _moved(self) -> Rows:
        """Return the displacements, (vertices, 3 frames), in float32 if that is precise enough."""
        if self._taken is None:
            self._taken = self._take()
        return self._taken[0]

    @cached_property
    def largest(self) -> float:
        """Return the largest magnitude of a displacement, here or in the displacements from which these are derived."""
        other = self._alike or self._sibling or (self._part_of and self._part_of[0])
        if other:
            return other.largest
        if self._taken is None:
            self._taken = self._take()
        return self._taken[1]

    def _take(self) -> tuple[Rows, float]:
        """Compute the displacements and their largest magnitude."""
        farthest, size = FARTHEST_STEPS * self._unit, (self._vertices, 3 * self._frames)

        def take(precision: type[np.floating[Any]]) -> tuple[Rows, float]:
            rows: Rows = np.empty(size, precision)
            return rows, _core.take_displacements(self._points, self._shape, farthest, rows, thread_count())

        rows, largest = take(np.float32)
        is_single = self._unit >= SINGLE_ROWS * largest and largest <= LARGEST_SINGLE
        return (rows, largest) if is_single else take(np.float64)

    @property
    def _is_wide(self) -> bool:
        return 3 * self._frames > self._vertices

    @cached_property
    def _span(self) -> Span | None:
        """Return a span of few trajectories that approximates the displacements; None if it needs too many."""
        if self._part_of:
            return None
        if self._sibling is None:
            return leading_span(self._moved, self._least)
        if self._sibling._span is None:
            return None
        still = np.tile(np.eye(3), (self._frames, 1))
        coefficients, axes = with_more(self._sibling._span, self._sibling._moved, still)
        return coefficients + self._shifted(self._sibling, axes, "trajectories"), axes

    @cached_property
    def _squares(self) -> Float64Array:
        """Return products of frames and axes summed over all vertices, (3 frames, 3 frames) float64."""
        if self._part_of:
            whole, frames = self._part_of
            own = slice(3 * frames.start, 3 * frames.stop)
            return np.ascontiguousarray(whole._squares[own, own])
        if self._sibling is not None:
            off = self._sibling._shape - self._shape
            moved = self._sibling._moved
            crossed = np.tile(_core.sums_of_products(moved, off.astype(moved.dtype), thread_count()), self._frames)
            squares: Float64Array = self._sibling._squares + crossed + crossed.T
            return squares + np.tile(sums_of_squares(off), (self._frames, self._frames))
        return sums_of_squares(self._moved)

    @cached_property
    def _squares_by_axis(self) -> Float64Array:
        """Return products of frames summed over all vertices and axes, (frames, frames) float64."""
        if self._part_of:
            whole, frames = self._part_of
            return np.ascontiguousarray(whole._squares_by_axis[frames, frames])
        if self._span is not None:
            coefficients, axes = self._span
            between, squares = sums_of_squares(coefficients), np.zeros((self._frames,) * 2)
            for x in range(3):
                along = axes[x::3]
                squares += product(product(along, between), along.T)
            return squares
        if self._is_wide:
            split = self._moved.reshape(self._vertices, self._frames, 3)
            return sums_of_squares(split.transpose(0, 2, 1).reshape(-1, self._frames))
        return self._squares[::3, ::3] + self._squares[1::3, 1::3] + self._squares[2::3, 2::3]

    @cached_property
    def _trajectories(self) -> tuple[Float64Array, Float64Array]:
        """Return the principal trajectories above the tail: energies (n,), falling, and functions (3 frames, n)."""
        if self._span is not None:
            return principal_axes_within(self._span, self._least)
        if self._is_wide:
            return principal_trajectories(self._moved.astype(np.float64), self._least)
        return principal_axes(self._squares, self._least)

    @cached_property
    def _shapes(self) -> tuple[Float64Array, Float64Array]:
        """Return principal functions that all axes share: energies (n,), falling, and functions (frames, n)."""
        return principal_axes(self._squares_by_axis, self._least)

    @cached_property
    def _poses(self) -> tuple[Float64Array, Float64Array]:
        """Return poses like :attr:`_shapes`: frames, each the farthest from the span of the previous ones.
        Empty if principal shapes need fewer functions.
        """
        products = self._squares_by_axis
        found = spanning(products, self._least / self._frames, self._shapes[0].size)
        if found is None or not found.size:
            return np.zeros(0), np.zeros((self._frames, 0))
        poses = np.sort(found)
        weights = product(pseudo_inverse(products[np.ix_(poses, poses)], ROUNDING), products[poses]).T
        lengths = np.sqrt((weights * weights).sum(axis=0))
        energies = lengths * lengths * products[poses, poses]
        order = np.argsort(-energies, kind="stable")
        return energies[order], (weights / lengths)[:, order]

    def settle(self, kind: TimeFunctions) -> None:
        """Keep the functions of one kind, its coefficients if computed, and the displacements; free everything else."""
        if kind == "cosines":
            _ = self._cosine_count
        else:
            self._settled = {one: self.functions(one) for one in {kind, principal(kind)}}
        _ = self._total
        kept = {kind: self._coefficients[kind]} if kind in self._coefficients else {}
        item: Displacements | None = self
        while item is not None:
            item._coefficients = {}
            for name in ("_squares", "_squares_by_axis", "_trajectories", "_shapes", "_poses"):
                item.__dict__.pop(name, None)
            item = item._alike or item._sibling
        self._coefficients = kept

    def release(self) -> None:
        """Free arrays as large as the group's positions that are quickly computed again."""
        _ = self._total, self.largest
        item: Displacements | None = self
        while item is not None:
            item._coefficients, item._taken, item._part_of = {}, None, None
            item.__dict__.pop("_span", None)
            item = item._alike or item._sibling

    @property
    def has_poses(self) -> bool:
        """Return whether few frames span all others."""
        return self.functions("poses")[0].size > 0

    def functions(self, kind: TimeFunctions) -> tuple[Float64Array, Float64Array]:
        """Return energies and unit functions of time by falling energy; not for cosines, which are fixed.

        Functions have one number per frame, trajectories three.
        """
        if kind in self._settled:
            return self._settled[kind]
        if self._alike is not None:
            return self._alike.functions(kind)
        if kind == "trajectories":
            return self._trajectories
        return self._poses if kind == "poses" else self._shapes

    def time_cost(self, kind: TimeFunctions, step: float) -> TimeFunctionCost:
        """Return the cost of the functions of time of a stored kind, measured at a step."""
        if self._alike is not None:
            return self._alike.time_cost(kind, step)
        if kind not in self._time_costs:
            self._time_costs[kind] = TimeFunctionCost(self.scaled(kind), step)
        return self._time_costs[kind]

    def scaled(self, kind: TimeFunctions) -> Float64Array:
        """Return functions of time as they are coded, scaled to the root of their energies: (frames, 3 or 1,
        functions) float64.
        """
        energies, functions = self.functions(kind)
        axes = 3 if kind == "trajectories" else 1
        return (functions * np.sqrt(energies)).reshape(self._frames, axes, energies.size)

    def has_coefficients(self, kind: TimeFunctions) -> bool:
        """Return whether coefficients of all vertices are known, or follow directly from known ones."""
        return kind in self._coefficients or (self._alike is not None and self._alike.has_coefficients(kind))

    def coefficients(self, kind: TimeFunctions) -> Rows:
        """Return the coefficients of all functions of a kind, (vertices, functions or 3 functions), and keep them."""
        if kind not in self._coefficients:
            self._coefficients[kind] = self.some_coefficients(kind)
        return self._coefficients[kind]

    def some_coefficients(self, kind: TimeFunctions, some: slice = slice(None), sight: Sight | None = None) -> Rows:
        """Return the coefficients of some functions without keeping them, or with `sight` their projection
        (rows, ...).
        """
        if self._alike is not None and sight is None and some == slice(None):
            found = self._alike.coefficients(kind).copy()
            found += self._shifted(self._alike, self._dual(kind), kind)
            return found
        return self._along(np.ascontiguousarray(self._dual(kind)[:, some]), kind, sight)

    def count(self, kind: TimeFunctions) -> int:
        """Return the number of functions of a kind."""
        return self._cosine_count if kind == "cosines" else int(self.functions(kind)[0].size)

    @cached_property
    def _cosine_energies(self) -> Float64Array:
        waves = cosines(self._frames, self._frames)
        energies: Float64Array = (waves * product(self._squares_by_axis, waves)).sum(axis=0)
        return energies

    @cached_property
    def _cosine_count(self) -> int:
        """Return the number of cosines, without the last ones if these carry almost no energy."""
        if self._alike is not None:
            return self._alike._cosine_count
        left = np.cumsum(self._cosine_energies[::-1])[::-1]
        return int(np.count_nonzero(left > self._least))

    def _dual(self, kind: TimeFunctions) -> Float64Array:
        """Return the functions that displacements are multiplied with to get coefficients of a kind."""
        if kind == "cosines":
            return cosines(self._frames, self._cosine_count)
        functions = self.functions(kind)[1]
        return dual_functions(functions) if kind == "poses" else functions

    def values(self, name: Seen) -> Rows:
        """Return an array for a :class:`Sight`, vertex by vertex."""
        if name == "moved":
            return self._moved
        if name == "span":
            assert self._span is not None  # only used if there is one
            return self._span[0]
        other = self._alike or self._sibling
        assert other is not None  # only used if there is another shape
        return other._shape - self._shape

    def along(self, functions: Float64Array, kind: TimeFunctions) -> Rows:
        """Return least-squares coefficients of unit functions of time: one per function, or one per axis.

        Decoded functions are not exactly orthogonal, poses not at all, and coarse ones may coincide.
        """
        return self._along(dual_functions(functions), kind)

    def _shifted(
        self, other: Displacements, dual: Float64Array, kind: TimeFunctions, sight: Sight | None = None
    ) -> Float64Array:
        """Return by how much products with displacements differ from those measured from another shape."""
        if kind == "trajectories":
            sums = dual.reshape(self._frames, 3, -1).sum(axis=0)
        else:
            sums = np.kron(dual.sum(axis=0), np.eye(3))
        return product(other._shape - self._shape if sight is None else sight.of(self, "shift"), sums)

    def _along(self, dual: Float64Array, kind: TimeFunctions, sight: Sight | None = None) -> Rows:
        """Return products of displacements and functions."""
        other = self._alike or self._sibling
        if self._alike is None and self._span is not None:
            coefficients, axes = self._span
            if sight is not None:
                coefficients = sight.of(self, "span")
            if kind == "trajectories":
                return products(coefficients, product(axes.T, dual))
            return products(coefficients, products(axes.T, dual, 3))
        if other is not None:
            found = other._along(dual, kind, sight)
            found += self._shifted(other, dual, kind, sight)
            return found
        rows = self._moved if sight is None else sight.of(self, "moved")
        return products(rows, dual, 1 if kind == "trajectories" else 3)

    @cached_property
    def _total(self) -> float:
        if self._alike is not None:
            return self._alike._total
        if self._span is not None:
            coefficients = self._span[0].ravel()  # coefficients of orthonormal trajectories
            return _core.sum_of_products(coefficients, coefficients)
        return float(np.trace(self._squares_by_axis))

    def explained(self, functions: int, kind: TimeFunctions) -> float:
        """Return the share of the motion's energy that the leading principal trajectories or shapes carry."""
        energies, _ = self.functions(principal(kind))
        return float(energies[:functions].sum()) / self._total if self._total > 0 else 1.0


def principal(kind: TimeFunctions) -> TimeFunctions:
    """Return the kind of principal functions whose energies describe a kind."""
    return "trajectories" if kind == "trajectories" else "shapes"


def dual_functions(functions: Float64Array) -> Float64Array:
    """Return the functions that displacements are multiplied with so that sums of `functions` approximate them best."""
    if not functions.size:
        return functions
    return product(functions, pseudo_inverse(sums_of_squares(functions), ALIKE))
