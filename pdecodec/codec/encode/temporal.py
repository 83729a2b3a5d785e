"""Displacements of a group of frames, and the functions of time that they are sums of, before quantisation."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any, Literal

import numpy as np

from pdecodec import _core
from pdecodec.codec.encode.tuning import Tuning
from pdecodec.codec.sections.groups import TimeBasis, cosines
from pdecodec.codec.sections.space_basis import Rows
from pdecodec.codec.sections.time_functions import TimeFunctionCost
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.system.shares import in_shares, thread_count

Origin = Literal["reference", "first"]
ORIGINS: tuple[Origin, ...] = ("reference", "first")
"""What displacements are measured from: the decoded reference frame, or the first frame as it came. The latter leaves
the reference frame's own error, which is the same in every frame, alone: what stands still then costs nothing."""

TimeFunctions = Literal["trajectories", "shapes", "poses", "cosines"]
TIME_FUNCTIONS: tuple[TimeFunctions, ...] = ("trajectories", "shapes", "poses", "cosines")
"""Principal trajectories; principal functions that are the same on all axes; how much there is of each of a few of the
group's own frames; cosines. Poses tell blend shapes and keyframes apart where principal functions mix them; a file has
them as shapes."""

FARTHEST_STEPS = 2.0**26
"""Displacements beyond so many bounds are no motion to be fitted: they are left to residuals."""

SINGLE_ROWS = 2.0**-12
"""Displacements and what is made of them are kept in float32 where the bound is at least this share of the largest:
half of it already costs robots that turn round 0.6 % more bytes."""

LARGEST_SINGLE = 2.0**40
"""Squares of what is larger, or smaller than one over it, may leave the range of float32 when they are added up."""

ALIKE = 1e-2
"""Functions that differ by less than this share (of their squared length) count as one in a fit."""

ROUNDING = 1e-14
"""What poses have less of than this share is rounding."""


def time_basis_of(functions: TimeFunctions) -> TimeBasis:
    """The time basis by which a file has functions of time."""
    return "shapes" if functions == "poses" else functions


SPAN_BLOCK, SPAN_BLOCKS = 64, 8
"""Signed sums of vertices in a block, and blocks of them: a block takes less time than decomposing all squares."""

MAX_SPAN_SHARE = 0.35
"""Share of all trajectories that a span may have: with more, decomposing the squares is quicker."""

SPAN_REST_SHARE = 0.1
"""What a span may leave out, as a share of what is left out of the trajectories in any case."""

WITHIN = 1e-12
"""Squared length of what is left of a unit vector, below which a span holds it."""

TINY = 1e-300
"""Takes the place of a length of zero."""

Span = tuple[Float64Array, Float64Array]
"""Coefficients (vertices, n) of orthonormal vectors (columns, n), whose product displacements are but for little."""

Seen = Literal["moved", "span", "shift"]
"""What displacements have that is looked at: themselves, coefficients of a span that they are in, how far the shape
that they are measured from is from another one."""


class Sight:
    """What a linear map of vertices makes of displacements: mapped once, they serve all functions of time.

    Parameters
    ----------
    project : callable
        Of values on vertices, (vertices, n) float32 or float64, makes (rows, n).
    longer : Sight, optional
        The same map, that has seen displacements which these are part of.
    """

    def __init__(self, project: Callable[[Rows], Rows], longer: Sight | None = None) -> None:
        self._project, self._longer = project, longer
        self._seen: dict[tuple[Displacements, Seen], Rows] = {}

    def of(self, owner: Displacements, name: Seen) -> Rows:
        """What the map makes of what an owner has by a name."""
        if (owner, name) not in self._seen:
            self._seen[owner, name] = self._look(owner, name)
        return self._seen[owner, name]

    def _look(self, owner: Displacements, name: Seen) -> Rows:
        if self._longer and owner.part_of:
            whole, frames = owner.part_of
            rows = self._longer.of(whole, name)
            return rows[:, 3 * frames.start : 3 * frames.stop] if name == "moved" else rows
        return self._project(owner.values(name))


class Displacements:
    """What is left of a group's positions when one shape is taken away.

    Parameters
    ----------
    points : (frames, vertices, 3) float32 [scene units]
    shape : (vertices, 3) float64 [scene units]
    unit : float [scene units]
        What the bound is, or more where float32 is coarser.
    tuning : Tuning
    alike : Displacements, optional
        Of the same points from nearly the same shape, whose functions of time will do here too.
    beside : Displacements, optional
        Of the same points from another shape, whose sums of squares tell what these are here.
    part_of : (Displacements, slice), optional
        Of more frames from the same shape, and which of them these are: what is found of those is not looked for again,
        as long as these are not put aside.
    """

    def __init__(
        self,
        points: Float32Array,
        shape: Float64Array,
        unit: float,
        tuning: Tuning,
        *,
        alike: Displacements | None = None,
        beside: Displacements | None = None,
        part_of: tuple[Displacements, slice] | None = None,
    ) -> None:
        self._points, self._shape, self._unit = points, np.ascontiguousarray(shape), unit
        self._tuning = tuning
        self._alike, self._beside = alike, beside
        self.part_of = part_of if part_of and part_of[0]._span is None and not part_of[0]._is_wide else None
        self._frames, self._vertices = len(points), len(shape)
        self._least = (tuning.tail * unit) ** 2 * self._vertices * self._frames
        self._taken: tuple[Rows, float] | None = None
        self._coefficients: dict[TimeFunctions, Rows] = {}
        self._settled: dict[TimeFunctions, tuple[Float64Array, Float64Array]] = {}
        self._time_costs: dict[TimeFunctions, TimeFunctionCost] = {}

    @property
    def _moved(self) -> Rows:
        """(vertices, 3 frames), in float32 where that is fine enough."""
        if self._taken is None:
            self._taken = self._take()
        return self._taken[0]

    @cached_property
    def largest(self) -> float:
        """The largest magnitude of a coordinate, or of displacements from a shape that is all but the same, or of those
        that these are part of.
        """
        other = self._alike or self._beside or (self.part_of and self.part_of[0])
        if other:
            return other.largest
        if self._taken is None:
            self._taken = self._take()
        return self._taken[1]

    def _take(self) -> tuple[Rows, float]:
        """Rows and their largest magnitude."""
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
        """Few trajectories and their coefficients, whose product displacements are but for little; None where it takes
        many.
        """
        if self.part_of:
            return None
        if self._beside is None:
            return leading_span(self._moved, self._least)
        if self._beside._span is None:
            return None
        still = np.tile(np.eye(3), (self._frames, 1))
        coefficients, axes = with_more(self._beside._span, self._beside._moved, still)
        return coefficients + self._shifted(self._beside, axes, "trajectories"), axes

    @cached_property
    def _squares(self) -> Float64Array:
        """(3 frames, 3 frames) float64: sums over all vertices."""
        if self.part_of:
            whole, frames = self.part_of
            own = slice(3 * frames.start, 3 * frames.stop)
            return np.ascontiguousarray(whole._squares[own, own])
        if self._beside is not None:
            off = self._beside._shape - self._shape
            moved = self._beside._moved
            crossed = np.tile(_core.sums_of_products(moved, off.astype(moved.dtype), thread_count()), self._frames)
            squares: Float64Array = self._beside._squares + crossed + crossed.T
            return squares + np.tile(sums_of_squares(off), (self._frames, self._frames))
        return sums_of_squares(self._moved)

    @cached_property
    def _squares_by_axis(self) -> Float64Array:
        """(frames, frames) float64: sums over all vertices and axes."""
        if self.part_of:
            whole, frames = self.part_of
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

    def _first(self, energies: Float64Array, functions: Float64Array) -> tuple[Float64Array, Float64Array]:
        most = self._tuning.most_time_functions
        return energies[:most], functions[:, :most]

    @cached_property
    def _trajectories(self) -> tuple[Float64Array, Float64Array]:
        """Principal trajectories that are worth looking at: energies (n,), falling, and functions (3 frames, n)."""
        if self._span is not None:
            return self._first(*principal_axes_within(self._span, self._least))
        if self._is_wide:
            return self._first(*principal_trajectories(self._moved.astype(np.float64), self._least))
        return self._first(*principal_axes(self._squares, self._least))

    @cached_property
    def _shapes(self) -> tuple[Float64Array, Float64Array]:
        """The same of functions of time that all axes share: energies (n,) and functions (frames, n)."""
        return self._first(*principal_axes(self._squares_by_axis, self._least))

    @cached_property
    def _poses(self) -> tuple[Float64Array, Float64Array]:
        """As :attr:`_shapes`, of frames each as far as can be from what those before it span; none where principal
        shapes need fewer functions.
        """
        products = self._squares_by_axis
        found = spanning(products, self._least / self._frames, int(self._tuning.pose_share * self._frames))
        if found is None or not 0 < found.size <= self._shapes[0].size:
            return np.zeros(0), np.zeros((self._frames, 0))
        poses = np.sort(found)
        weights = product(pseudo_inverse(products[np.ix_(poses, poses)], ROUNDING), products[poses]).T
        lengths = np.sqrt((weights * weights).sum(axis=0))
        energies = lengths * lengths * products[poses, poses]
        order = np.argsort(-energies, kind="stable")
        return energies[order], (weights / lengths)[:, order]

    def settle(self, kind: TimeFunctions) -> None:
        """Keep functions of one kind, its coefficients if they are there, and displacements; forget all else."""
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
            item = item._alike or item._beside
        self._coefficients = kept

    def put_aside(self) -> None:
        """Forget what is as large as the group's positions and soon found again."""
        _ = self._total, self.largest
        item: Displacements | None = self
        while item is not None:
            item._coefficients, item._taken, item.part_of = {}, None, None
            item.__dict__.pop("_span", None)
            item = item._alike or item._beside

    @property
    def has_poses(self) -> bool:
        """Whether few frames span all others."""
        return self.functions("poses")[0].size > 0

    def functions(self, kind: TimeFunctions) -> tuple[Float64Array, Float64Array]:
        """Energies and unit functions of time, by falling energy; not of cosines, which need no looking for.

        Functions have as many numbers as frames, those of trajectories three times as many.
        """
        if kind in self._settled:
            return self._settled[kind]
        if self._alike is not None:
            return self._alike.functions(kind)
        if kind == "trajectories":
            return self._trajectories
        return self._poses if kind == "poses" else self._shapes

    def time_cost(self, kind: TimeFunctions, step: float) -> TimeFunctionCost:
        """What functions of time of a kind that is stored take, measured at a step."""
        if self._alike is not None:
            return self._alike.time_cost(kind, step)
        if kind not in self._time_costs:
            self._time_costs[kind] = TimeFunctionCost(self.scaled(kind), step)
        return self._time_costs[kind]

    def scaled(self, kind: TimeFunctions) -> Float64Array:
        """(frames, 3 or 1, functions) float64: functions of time as they are coded, of the energies' lengths."""
        energies, functions = self.functions(kind)
        axes = 3 if kind == "trajectories" else 1
        return (functions * np.sqrt(energies)).reshape(self._frames, axes, energies.size)

    def has_coefficients(self, kind: TimeFunctions) -> bool:
        """Whether coefficients of all vertices are there, or follow at once from those that are."""
        return kind in self._coefficients or (self._alike is not None and self._alike.has_coefficients(kind))

    def coefficients(self, kind: TimeFunctions) -> Rows:
        """(vertices, functions or 3 functions), as precise as displacements: of all functions of a kind, kept."""
        if kind not in self._coefficients:
            self._coefficients[kind] = self.some_coefficients(kind)
        return self._coefficients[kind]

    def some_coefficients(self, kind: TimeFunctions, some: slice = slice(None), sight: Sight | None = None) -> Rows:
        """The same of some functions, not kept; or (rows, functions or 3 functions), what a linear map makes of it."""
        if self._alike is not None and sight is None and some == slice(None):
            found = self._alike.coefficients(kind).copy()
            found += self._shifted(self._alike, self._dual(kind), kind)
            return found
        return self._along(np.ascontiguousarray(self._dual(kind)[:, some]), kind, sight)

    def count(self, kind: TimeFunctions) -> int:
        """How many functions of a kind there are."""
        return self._cosine_count if kind == "cosines" else int(self.functions(kind)[0].size)

    @cached_property
    def _cosine_energies(self) -> Float64Array:
        waves = cosines(self._frames, min(self._frames, self._tuning.most_time_functions))
        energies: Float64Array = (waves * product(self._squares_by_axis, waves)).sum(axis=0)
        return energies

    @cached_property
    def _cosine_count(self) -> int:
        """Cosines but for the last ones, as far as they carry next to nothing."""
        if self._alike is not None:
            return self._alike._cosine_count
        left = np.cumsum(self._cosine_energies[::-1])[::-1]
        return int(np.count_nonzero(left > self._least))

    def _dual(self, kind: TimeFunctions) -> Float64Array:
        """What displacements are multiplied with, to have coefficients of functions of a kind."""
        if kind == "cosines":
            return cosines(self._frames, self._cosine_count)
        functions = self.functions(kind)[1]
        return dual_functions(functions) if kind == "poses" else functions

    def values(self, name: Seen) -> Rows:
        """What a :class:`Sight` looks at, vertex by vertex."""
        if name == "moved":
            return self._moved
        if name == "span":
            assert self._span is not None  # looked at where there is one
            return self._span[0]
        other = self._alike or self._beside
        assert other is not None  # the shape that the shift is from
        return other._shape - self._shape

    def along(self, functions: Float64Array, kind: TimeFunctions) -> Rows:
        """Coefficients of unit functions of time by least squares: one each, or one for each axis after another.

        Decoded functions are not quite orthogonal, poses not at all, and coarse ones may coincide.
        """
        return self._along(dual_functions(functions), kind)

    def _shifted(
        self, other: Displacements, dual: Float64Array, kind: TimeFunctions, sight: Sight | None = None
    ) -> Float64Array:
        """By how much sums of displacements times functions differ from those of another shape, which is constant."""
        if kind == "trajectories":
            sums = dual.reshape(self._frames, 3, -1).sum(axis=0)
        else:
            sums = np.kron(dual.sum(axis=0), np.eye(3))
        return product(other._shape - self._shape if sight is None else sight.of(self, "shift"), sums)

    def _along(self, dual: Float64Array, kind: TimeFunctions, sight: Sight | None = None) -> Rows:
        """Sums of displacements times functions."""
        other = self._alike or self._beside
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
            coefficients = self._span[0].ravel()  # of orthonormal trajectories
            return _core.sum_of_products(coefficients, coefficients)
        return float(np.trace(self._squares_by_axis))

    def explained(self, functions: int, kind: TimeFunctions) -> float:
        """Share of the motion's energy that the leading principal trajectories or shapes carry."""
        energies, _ = self.functions(principal(kind))
        return float(energies[:functions].sum()) / self._total if self._total > 0 else 1.0


def principal(kind: TimeFunctions) -> TimeFunctions:
    """The principal functions whose energies tell what those of a kind carry."""
    return "trajectories" if kind == "trajectories" else "shapes"


def spanning(products: Float64Array, least: float, most: int) -> Int64Array | None:
    """Of vectors whose inner products are given, (n, n), those that span all others up to squares of `least`.

    Each is the farthest from what those before it span: a Cholesky decomposition with pivots. None where it takes more
    than `most`.
    """
    left, rows = products.diagonal().copy(), np.zeros((most, len(products)))
    pivots: list[int] = []
    while (farthest := int(np.argmax(left))) not in pivots and left[farthest] > least:
        count = len(pivots)
        if count == most:
            return None
        row = products[farthest] - product(rows[:count, farthest][None], rows[:count])[0]
        rows[count] = row / math.sqrt(left[farthest])
        left -= rows[count] * rows[count]
        left[farthest] = 0.0
        pivots.append(farthest)
    return np.array(pivots, np.int64)


def dual_functions(functions: Float64Array) -> Float64Array:
    """What displacements are multiplied with, so that sums of `functions` come out nearest to them."""
    if not functions.size:
        return functions
    return product(functions, pseudo_inverse(sums_of_squares(functions), ALIKE))


def principal_trajectories(moved: Float64Array, least: float) -> tuple[Float64Array, Float64Array]:
    """The leading principal trajectories, as many as leave at most `least` of the energy.

    Parameters
    ----------
    moved : (vertices, n) float64
        Displacements; n = 3 frames.
    least : float
        Sum of squares that may be left out, 0 or more.

    Returns
    -------
    energies : (k,) float64
        Sums of squares, falling.
    axes : (n, k) float64
        Unit vectors, the largest number of each positive.
    """
    is_wide = moved.shape[1] > moved.shape[0]
    if not is_wide:
        return principal_axes(sums_of_squares(moved), least)
    energies, axes = principal_axes(sums_of_squares(moved.T), least)
    axes = product(moved.T, axes)
    axes /= np.maximum(np.sqrt((axes * axes).sum(axis=0)), TINY)
    return energies, _turned(axes)


def principal_axes(squares: Float64Array, least: float) -> tuple[Float64Array, Float64Array]:
    """The same from the sums of squares, (n, n), of all vertices."""
    energies, axes = eigen(squares)
    energies = np.maximum(energies, 0.0)
    kept = _count_of_leading(energies, float(np.trace(squares)), least)
    return energies[:kept], _turned(axes[:, :kept])


def _count_of_leading(energies: Float64Array, total: float, least: float) -> int:
    """How many of falling energies leave at most `least` of a total; all where none do."""
    left = total - np.append(0.0, np.cumsum(energies))
    enough = np.flatnonzero(left <= least)
    return int(enough[0]) if enough.size else energies.size


def _turned(axes: Float64Array) -> Float64Array:
    """With the largest number of each axis positive."""
    largest = axes[np.argmax(np.abs(axes), axis=0), np.arange(axes.shape[1])]
    return axes * np.where(largest < 0.0, -1.0, 1.0)


def sums_of_squares(rows: Rows) -> Float64Array:
    """Return ``rows.T @ rows`` in float64, (n, n), of rows (vertices, n)."""
    return _core.sums_of_squares(np.ascontiguousarray(rows), False, thread_count())


def product(left: Float64Array, right: Float64Array) -> Float64Array:
    """``left @ right``, of two matrices."""
    # Copied here and not there: that there is no memory for it is a MemoryError here, and a wrong argument there.
    return _core.product(left, np.ascontiguousarray(right), thread_count())


def eigen(squares: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Eigenvalues, falling, and eigenvectors (columns) of a symmetric matrix."""
    values, vectors = _core.symmetric_eigen(squares, True, thread_count())
    return values, vectors.T


def pseudo_inverse(squares: Float64Array, alike: float) -> Float64Array:
    """Of a symmetric matrix, where eigenvalues below a share of the largest count as none."""
    values, vectors = eigen(squares)
    sizes = np.abs(values)
    is_used = sizes > alike * sizes.max(initial=0.0)
    return product(vectors[:, is_used] / values[is_used], vectors[:, is_used].T)


def orthonormal(vectors: Float64Array) -> Float64Array:
    """Orthonormal vectors, as many as are given, that span these; in columns."""
    return _core.orthonormal_columns(vectors).vectors.T


def leading_span(rows: Rows, least: float) -> Span | None:
    """Orthonormal vectors that span all but about :data:`SPAN_REST_SHARE` of `least` of the rows' energy.

    None where that takes so many that the squares are quicker.

    Parameters
    ----------
    rows : (vertices, n) float32 or float64
    least : float
        Sum of squares.
    """
    vertices, size = rows.shape
    most = int(MAX_SPAN_SHARE * min(vertices, size))
    if min(vertices, size) < SPAN_BLOCKS * SPAN_BLOCK:
        return None
    sums = _signed_sums(rows)
    axes = np.zeros((size, 0))
    before = math.inf
    for block in range(SPAN_BLOCKS):
        signs = np.array([[-1.0 if (block & other).bit_count() % 2 else 1.0 for other in range(SPAN_BLOCKS)]])
        left = _outside(product(signs, sums).reshape(SPAN_BLOCK, size).T, axes)
        energy = float(np.square(left).sum())
        if energy <= SPAN_REST_SHARE * least:
            return products(rows, axes), axes
        # What is left falls more slowly from block to block.
        blocks = min(most // SPAN_BLOCK, SPAN_BLOCKS - 1) - block
        if blocks <= 0 or (block > 1 and energy * math.prod([energy / before] * blocks) > SPAN_REST_SHARE * least):
            return None
        before = energy
        more = orthonormal(left)
        if axes.size:  # once more, for what rounding left of them
            more = orthonormal(_outside(more, axes))
        axes = np.concatenate([axes, more], axis=1)
    return None


def _signed_sums(rows: Rows) -> Float64Array:
    """(SPAN_BLOCKS, SPAN_BLOCK n) float64: each row is added to one of the sums, or taken from it."""
    count = SPAN_BLOCKS * SPAN_BLOCK
    sums = np.zeros((count, rows.shape[1]), rows.dtype)
    hashed = (np.arange(len(rows), dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)
    signs = (1.0 - 2.0 * (hashed & np.uint64(1))).astype(rows.dtype)

    def add_up(first: int, end: int) -> None:
        for begin in range(0, len(rows), count):
            some = slice(begin + first, min(begin + end, len(rows)))
            some_rows = rows[some]
            sums[first : first + len(some_rows)] += some_rows * signs[some, None]

    in_shares(add_up, count)
    return sums.astype(np.float64).reshape(SPAN_BLOCKS, -1)


def _outside(vectors: Float64Array, axes: Float64Array) -> Float64Array:
    """What orthonormal axes leave of vectors, both in columns."""
    return vectors - product(axes, product(axes.T, vectors))


def with_more(span: Span, rows: Rows, vectors: Float64Array) -> Span:
    """A span with vectors, (n, few), in it too; `rows` are those that it is of."""
    coefficients, axes = span
    for vector in vectors.T:
        left = _outside(vector[:, None] / np.sqrt(max(float(np.square(vector).sum()), TINY)), axes)
        length = float(np.square(left).sum())
        if length > WITHIN:
            left = _outside(left / np.sqrt(length), axes)
            axes = np.concatenate([axes, left / np.sqrt(np.square(left).sum())], axis=1)
    more = axes[:, coefficients.shape[1] :]
    return np.concatenate([coefficients, products(rows, more)], axis=1), axes


def principal_axes_within(span: Span, least: float) -> tuple[Float64Array, Float64Array]:
    """:func:`principal_trajectories` of what a span holds."""
    coefficients, axes = span
    energies, turned = eigen(sums_of_squares(coefficients))
    energies = np.maximum(energies, 0.0)
    left = np.append(np.cumsum(energies[::-1])[::-1], 0.0)
    kept = int(np.argmax(left <= least))
    return energies[:kept], _turned(product(axes, turned[:, :kept]))


def products(rows: Rows, factors: Float64Array, axes: int = 1) -> Rows:
    """``rows @ factors`` in the rows' precision, (vertices, k).

    With axes the columns of rows are (n, axes) numbers, those of what is found (k, axes).
    """
    return _core.multiply_rows(np.ascontiguousarray(rows), factors, axes, thread_count())
