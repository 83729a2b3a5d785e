"""What ways to encode a group of frames would take, on large meshes without fitting all of it.

Functions of time are coded once and their bits at other steps follow from that. Coefficients and residuals are those of
some elements from all over the mesh and of the nodes of the partition tree above them, and counted as many times as
those are part of it. Small meshes, where that is quick, are fitted in full.
"""

from __future__ import annotations

from functools import partial
from typing import Protocol

import numpy as np

from pdecodec import _core
from pdecodec.codec.encode.fit import Candidate, GroupFitter
from pdecodec.codec.encode.quantise import axes_of, cosines_needed, grid_step, needed_functions, quantise_sparsely
from pdecodec.codec.encode.temporal import Displacements, Sight, TimeFunctions, time_basis_of
from pdecodec.codec.encode.tuning import Tuning
from pdecodec.codec.sections.groups import GroupEntry, functions_of_time, group_functions, margins
from pdecodec.codec.sections.residuals import prediction_choices
from pdecodec.codec.sections.space_basis import Rows, SpaceBasis
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.system.shares import in_shares, side_by_side, thread_count

FRAME_RUN = 8
"""Where frames are sampled, residuals are looked at in every other run of so many: they are coded by those of the frame
before."""

WHOLE_DEPTHS = 8
"""Nodes of the partition tree down to this depth are looked at whatever elements are below them: they are few."""

ROWS_AT_ONCE = 256
"""Rows of coefficients that are weighed at once: as many as caches hold."""


class BitCounter(Protocol):
    """Counts what a group takes in one space basis."""

    def bits(self, choice: Candidate) -> float:
        """What a group takes that way, about or exactly."""

    def prepare(self, choice: Candidate) -> None:
        """Compute what choices of a time basis and origin share: calls in several threads would each do it."""


def bit_counter(
    fitter: GroupFitter,
    basis: SpaceBasis,
    like: BitCounter | None = None,
    *,
    part_of: BitCounter | None = None,
    compares_bases: bool = False,
) -> BitCounter:
    """Return a counter by full fits of a small mesh, by estimates from a sample of a large one."""
    if not fitter.is_large:
        return FitCounter(fitter, basis)
    alike, longer = (other if isinstance(other, Estimate) else None for other in (like, part_of))
    return Estimate(fitter, basis, alike, part_of=longer, compares_bases=compares_bases)


class FitCounter:
    """What full fits take."""

    def __init__(self, fitter: GroupFitter, basis: SpaceBasis) -> None:
        self._fitter, self._basis = fitter, basis

    def prepare(self, choice: Candidate) -> None:
        self._fitter.prepare(choice)

    def bits(self, choice: Candidate) -> float:
        return self._fitter.fit(self._basis, choice, is_trial=True).bits


class _Sample:
    """Some elements of a space basis, and what they are looked at for.

    Parameters
    ----------
    fitter : GroupFitter
    basis : SpaceBasis
    elements : (n,) int64
        Ascending.
    weight : float
        How many times as much all elements' coefficients take as those of these, about.
    like : _Sample, optional
        Of the same points.

    Attributes
    ----------
    elements : (n,) int64
    vertices : (m,) int32
        Theirs, element after element.
    starts : (n + 1,) int64
        Of each element among the vertices.
    order : (m,) int32
        The vertices' places: as they stand.
    frames : (l,) int64
        Whose residuals are looked at.
    points : (l, m, 3) float32 [scene units]
    copies, weight : float
        How many times as many positions there are, and how many times as much all elements' coefficients take, about.
    chosen : (n,) int64
        Subbands of these elements, and of the nodes above them.
    subbands : (starts, kinds, parents)
        As :attr:`pdecodec.codec.sections.space_basis.SpaceBasis.subbands`, of these.
    subband_copies : (n,) float64
        How many times as much the coefficients of all take that each stands for, about.
    """

    def __init__(
        self,
        fitter: GroupFitter,
        basis: SpaceBasis,
        elements: Int64Array,
        weight: float,
        like: _Sample | None = None,
    ) -> None:
        points, sample_frames = fitter.points, fitter.tuning.sample_frames
        self.elements, self.weight = elements, weight
        self.starts = np.concatenate([[0], np.cumsum(np.diff(basis.starts)[elements])])
        self.vertices = _vertices(basis, elements)
        self.order = np.arange(self.vertices.size, dtype=np.int32)
        runs = np.arange(len(points))
        self.frames = runs[runs // FRAME_RUN % 2 == 0] if runs.size > sample_frames else runs
        self.points: Float32Array
        if like and np.array_equal(self.vertices, like.vertices):
            self.points = like.points
        else:
            self.points = np.empty((self.frames.size, self.vertices.size, 3), np.float32)

            def take(first: int, end: int) -> None:
                self.points[first:end] = points[self.frames[first:end]].take(self.vertices, axis=1)

            in_shares(take, self.frames.size)
        self.copies = basis.order.size / self.vertices.size * (runs.size / self.frames.size)
        starts, kinds, parents = basis.subbands
        self.chosen = basis.subbands_of(elements, least_depth=WHOLE_DEPTHS)
        sizes, depths = np.diff(starts), np.maximum(kinds, -1)
        own_sizes, own_depths = sizes[self.chosen], depths[self.chosen]
        self.subbands = (
            np.concatenate([[0], np.cumsum(own_sizes)]),
            kinds[self.chosen],
            np.searchsorted(self.chosen, parents[self.chosen]),
        )
        # Nodes of a depth are all but equal; elements are not.
        of_all, of_chosen = np.bincount(depths + 1, sizes), np.bincount(own_depths + 1, own_sizes)
        self.subband_copies = of_all[own_depths + 1] / np.maximum(of_chosen[own_depths + 1], 1.0)
        self.subband_copies[own_depths < 0] = weight


def _vertices(basis: SpaceBasis, elements: Int64Array) -> Int32Array:
    """Vertices of some elements, element after element."""
    parts = [basis.order[basis.starts[e] : basis.starts[e + 1]] for e in elements]
    return np.concatenate(parts) if parts else np.zeros(0, np.int32)


def _weights(basis: SpaceBasis, coefficients: Rows, step: float) -> Float64Array:
    """(elements,) float64: about what each takes; some of them take many times as much as others.

    Parameters
    ----------
    basis : SpaceBasis
    coefficients : (functions of space, channels)
        In any functions of time.
    step : float
        Their quantisation step.
    """
    rough = np.zeros(len(coefficients) + 1)

    def add_up(first: int, end: int) -> None:
        for begin in range(first, end, ROWS_AT_ONCE):
            some = slice(begin, min(begin + ROWS_AT_ONCE, end))
            rough[some] = _core.binary_logarithms(1.0 + np.square(coefficients[some] / step)).sum(axis=1)

    in_shares(add_up, len(coefficients))
    weights: Float64Array = np.add.reduceat(rough, basis.coefficient_starts[:-1])
    weights[np.diff(basis.coefficient_starts) == 0] = 0.0
    return weights


def _chosen(basis: SpaceBasis, weights: Float64Array, tuning: Tuning, *, compares_bases: bool) -> Int64Array:
    """Return elements from all over the mesh, of those that take little as of those that take much.

    Where spatial bases are compared, all elements of a part of the partition tree are taken, or none, so that smaller
    and larger ones are of the same vertices.

    Parameters
    ----------
    basis : SpaceBasis
    weights : (elements,) float64
        About what each takes.
    tuning : Tuning
    """
    part_of = np.unique(_parts(basis, tuning.sample_part if compares_bases else 1), return_inverse=True)[1]
    part_weights = np.bincount(part_of, weights)
    vertices = basis.order.size
    share = min(max(tuning.sample_vertices / vertices, tuning.sample_share), 1.0)
    sampled = max(1, round(share * part_weights.size))
    places = ((np.arange(sampled) + 0.5) * part_weights.size / sampled).astype(np.int64)
    return np.flatnonzero(np.isin(part_of, np.argsort(part_weights, kind="stable")[places]))


def _parts(basis: SpaceBasis, most: int) -> Int64Array:
    """Return the highest node of the partition tree above each element of at most `most` vertices, or its own."""
    children, node_of = basis.patches.children, basis.patches.node_of
    sizes = np.zeros(children.size, np.int64)
    sizes[node_of] = np.diff(basis.starts)
    for node in range(children.size - 1, -1, -1):
        if children[node] >= 0:
            sizes[node] = sizes[children[node]] + sizes[children[node] + 1]
    parts = np.full(children.size, -1)
    for node in range(children.size):
        if parts[node] < 0 and (sizes[node] <= most or children[node] < 0):
            parts[node] = node
        if children[node] >= 0:
            parts[children[node] : children[node] + 2] = parts[node]
    found: Int64Array = parts[node_of]
    return found


def _of_vertices(basis: SpaceBasis, vertices: Int32Array) -> Int64Array:
    """Elements that are of given vertices, for the most part."""
    given = np.zeros(basis.order.size, np.int64)
    given[vertices] = 1
    found: Int64Array = np.flatnonzero(
        2 * np.add.reduceat(given[basis.order], basis.starts[:-1]) > np.diff(basis.starts)
    )
    return found


class Estimate:
    """Estimates from some elements of the mesh.

    Parameters
    ----------
    fitter : GroupFitter
        Of the whole mesh.
    basis : SpaceBasis
    like : Estimate, optional
        Of the same points, in another space basis or from another reference frame: the same vertices are looked at.
    part_of : Estimate, optional
        Of more frames in the same space basis: the same elements are looked at, and taken for as much of all, so that
        what parts take is compared with what the whole takes on the same vertices.

    Attributes
    ----------
    basis : SpaceBasis
    sample : _Sample
    """

    def __init__(
        self,
        fitter: GroupFitter,
        basis: SpaceBasis,
        like: Estimate | None = None,
        *,
        part_of: Estimate | None = None,
        compares_bases: bool = False,
    ) -> None:
        self._fitter, self.basis = fitter, basis
        self._usual_step = grid_step(fitter.first_choice.step)
        self._coefficients: dict[tuple[Displacements, TimeFunctions], Rows] = {}
        self.sample: _Sample
        if part_of:
            self.sample = _Sample(fitter, basis, part_of.sample.elements, part_of.sample.weight)
        else:
            self.sample = self._looked_at(like, compares_bases)
        project = partial(basis.project_some, subbands=self.sample.chosen)
        self._sight: Sight = Sight(project, part_of._sight if part_of else None)

    def _looked_at(self, like: Estimate | None, compares_bases: bool) -> _Sample:
        fitter, basis = self._fitter, self.basis
        elements = _of_vertices(basis, like.sample.vertices) if like else np.zeros(0, np.int64)
        if like and np.array_equal(np.sort(_vertices(basis, elements)), np.sort(like.sample.vertices)):
            return _Sample(fitter, basis, elements, like.sample.weight, like.sample)
        weights = _weights(basis, fitter.weighed(basis), self._usual_step)
        if not elements.size:
            elements = _chosen(basis, weights, fitter.tuning, compares_bases=compares_bases)
        sampled = float(weights[elements].sum())
        return _Sample(fitter, basis, elements, float(weights.sum()) / sampled if sampled else 1.0)

    def prepare(self, choice: Candidate) -> None:
        moved = self._fitter.displacements(choice.origin)
        self._projected(moved, choice.time)
        if choice.time != "cosines":
            moved.time_cost(choice.time, self._usual_step)

    def _projected(self, moved: Displacements, time: TimeFunctions) -> Rows:
        """Coefficients (rows of the sample, channels) of all functions of time of a kind."""
        if (moved, time) not in self._coefficients:
            self._coefficients[moved, time] = (
                moved.some_coefficients(time, sight=self._sight).astype(np.float32, copy=False)
                if self._fitter.is_heavy or not moved.has_coefficients(time)
                else self.basis.project_some(moved.coefficients(time), self.sample.chosen)
            )
        return self._coefficients[moved, time]

    def bits(self, choice: Candidate) -> float:
        sample, axes, step = self.sample, axes_of(choice.time), grid_step(choice.step)
        moved, frames = self._fitter.displacements(choice.origin), self._fitter.frames
        quantised, largest = quantise_sparsely(
            self._projected(moved, choice.time), step, axes, self._fitter.tuning.dead_zones[0]
        )
        time_bits = time_step = 0.0
        if choice.time == "cosines":
            count = cosines_needed(largest)
            quantised, largest = np.ascontiguousarray(quantised[:, : axes * count]), largest[: axes * count]
            functions = np.zeros((frames, 1, 0))
        else:
            used = needed_functions(largest, axes)
            count = used.size
            if axes * count < largest.size:
                channels = (axes * used[:, None] + np.arange(axes)).ravel()
                quantised, largest = np.take(quantised, channels, axis=1), largest[channels]
            time_step = grid_step(choice.step + choice.time_step)
            cost = moved.time_cost(choice.time, self._usual_step)
            time_bits, functions = cost.bits(used, time_step), cost.rounded(used, time_step)
        entry = GroupEntry(
            frames=frames,
            functions=count,
            basis=time_basis_of(choice.time),
            single=self._fitter.is_single and count > 0,
            step=step,
            time_step=time_step,
        )
        coefficient_bits, residual_bits = side_by_side(
            partial(_core.measure_coefficients, quantised, *sample.subbands, axes, sample.subband_copies)
            if count
            else float,
            partial(self._residual_bits, entry, functions, quantised, largest),
        )
        return time_bits + coefficient_bits + residual_bits

    def _residual_bits(
        self, entry: GroupEntry, functions: Float64Array, quantised: Int64Array, largest: Int64Array
    ) -> float:
        fitter, sample = self._fitter, self.sample
        time = functions_of_time(entry, functions, fitter.times)
        moved = group_functions(entry, time[sample.frames], quantised, self.basis, sample.chosen)
        model = fitter.held(moved, sample.points, sample.order)
        limits = margins(entry, time, largest, fitter.residual_step)[sample.frames]
        residuals, _, _ = model.missing(limits, None, None, False, thread_count())
        near = np.ones(sample.frames.size, np.int64)

        ways = prediction_choices(residuals, sample.order.size)
        return min(_core.measure_residuals(residuals, sample.starts, way, near, sample.copies) for way in ways)
