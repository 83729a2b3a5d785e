"""Cost of candidates in bits: full fits on small meshes, estimates from a sample on large ones.

In an estimate, functions of time are coded once, and their bits at other steps follow from that. Coefficients and
residuals are measured on a sample of elements from all over the mesh, with the nodes of the partition tree above
them, and scaled up to the whole mesh.
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
"""Length of a run of frames; every second run is sampled. Runs are sampled whole, because residuals are coded
with the frame before as context.
"""

WHOLE_DEPTHS = 8
"""Depth of the partition tree up to which all nodes are sampled, because they are few."""

ROWS_AT_ONCE = 256
"""Rows of coefficients that are sampled_coefficients at once: as many as caches hold."""


class BitCounter(Protocol):
    """Counter of the bits of a group in one spatial basis."""

    def bits(self, choice: Candidate) -> float:
        """Return the bits of a candidate, measured or estimated."""

    def prepare(self, choice: Candidate) -> None:
        """Compute results that all candidates of a temporal basis and origin share, so that threads do not each
        compute them.
        """


def bit_counter(
    fitter: GroupFitter,
    basis: SpaceBasis,
    like: BitCounter | None = None,
    *,
    part_of: BitCounter | None = None,
    compares_bases: bool = False,
) -> BitCounter:
    """Return a counter: by full fits on a small mesh, by estimates from a sample on a large one."""
    if not fitter.is_large:
        return FitCounter(fitter, basis)
    alike, longer = (other if isinstance(other, Estimate) else None for other in (like, part_of))
    return Estimate(fitter, basis, alike, part_of=longer, compares_bases=compares_bases)


class FitCounter:
    """Counter by full fits."""

    def __init__(self, fitter: GroupFitter, basis: SpaceBasis) -> None:
        self._fitter, self._basis = fitter, basis

    def prepare(self, choice: Candidate) -> None:
        self._fitter.prepare(choice)

    def bits(self, choice: Candidate) -> float:
        return self._fitter.fit(self._basis, choice, is_trial=True).bits


class _Sample:
    """Sample of the elements of a spatial basis.

    Parameters
    ----------
    fitter : GroupFitter
    basis : SpaceBasis
    elements : (n,) int64
        Ascending.
    weight : float
        Estimated ratio of the bits of all elements' coefficients to those of the sample.
    like : _Sample, optional
        Sample of the same points.

    Attributes
    ----------
    elements : (n,) int64
    vertices : (m,) int32
        Vertices of the elements, element after element.
    starts : (n + 1,) int64
        First position of each element among the vertices.
    order : (m,) int32
        Positions of the vertices: 0 to m - 1.
    frames : (l,) int64
        Frames whose residuals are measured.
    points : (l, m, 3) float32 [scene units]
    copies, weight : float
        Ratio of all positions to those in the sample, and estimated ratio of the bits of coefficients.
    chosen : (n,) int64
        Subbands of these elements, and of the nodes above them.
    subbands : (starts, kinds, parents)
        Like :attr:`pdecodec.codec.sections.space_basis.SpaceBasis.subbands`, of the sample.
    subband_copies : (n,) float64
        Estimated ratio of the bits of all subbands to the one in the sample that stands for them.
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
        # Nodes of the same depth have almost equal costs, elements do not, so nodes are scaled by number, elements by
        # weight.
        of_all, of_chosen = np.bincount(depths + 1, sizes), np.bincount(own_depths + 1, own_sizes)
        self.subband_copies = of_all[own_depths + 1] / np.maximum(of_chosen[own_depths + 1], 1.0)
        self.subband_copies[own_depths < 0] = weight


def _vertices(basis: SpaceBasis, elements: Int64Array) -> Int32Array:
    """Return the vertices of some elements, element after element."""
    parts = [basis.order[basis.starts[e] : basis.starts[e + 1]] for e in elements]
    return np.concatenate(parts) if parts else np.zeros(0, np.int32)


def _weights(basis: SpaceBasis, coefficients: Rows, step: float) -> Float64Array:
    """Return a rough cost of each element, (elements,) float64; some cost many times as much as others.

    Parameters
    ----------
    basis : SpaceBasis
    coefficients : (functions of space, channels)
        Coefficients in any functions of time.
    step : float
        Quantisation step of the coefficients.
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
    """Return a sample of elements from all over the mesh, with cheap and expensive ones in proportion.

    If spatial bases are compared, nodes of the partition tree of the size of the largest patch are sampled as a whole,
    so that smaller and larger elements cover the same vertices.

    Parameters
    ----------
    basis : SpaceBasis
    weights : (elements,) float64
        Rough cost of each element.
    tuning : Tuning
    """
    largest = max(points for _, points in tuning.spatial_bases) if compares_bases else 1
    part_of = np.unique(_parts(basis, largest), return_inverse=True)[1]
    part_weights = np.bincount(part_of, weights)
    vertices = basis.order.size
    share = min(max(tuning.sample_vertices / vertices, tuning.sample_share), 1.0)
    sampled = max(1, round(share * part_weights.size))
    places = ((np.arange(sampled) + 0.5) * part_weights.size / sampled).astype(np.int64)
    return np.flatnonzero(np.isin(part_of, np.argsort(part_weights, kind="stable")[places]))


def _parts(basis: SpaceBasis, most: int) -> Int64Array:
    """Return, for each element, the highest node of the partition tree above it with at most `most` vertices;
    the element's own node if every node above it has more.
    """
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
    """Return the elements more than half of whose vertices are among the given ones."""
    given = np.zeros(basis.vertices, np.int64)
    given[vertices] = 1
    found: Int64Array = np.flatnonzero(
        2 * np.add.reduceat(given[basis.order], basis.starts[:-1]) > np.diff(basis.starts)
    )
    return found


class Estimate:
    """Counter by estimates from a sample of the mesh's elements.

    Parameters
    ----------
    fitter : GroupFitter
        Fitter of the whole mesh.
    basis : SpaceBasis
    like : Estimate, optional
        Estimate of the same points in another spatial basis or from another reference frame: the same vertices are
        sampled.
    part_of : Estimate, optional
        Estimate of more frames in the same spatial basis: the same elements are sampled and scaled by the same ratio,
        so that costs of the parts and of the whole are comparable.

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
        self._sight = Sight(project)

    def _looked_at(self, like: Estimate | None, compares_bases: bool) -> _Sample:
        fitter, basis = self._fitter, self.basis
        elements = _of_vertices(basis, like.sample.vertices) if like else np.zeros(0, np.int64)
        if like and np.array_equal(np.sort(_vertices(basis, elements)), np.sort(like.sample.vertices)):
            return _Sample(fitter, basis, elements, like.sample.weight, like.sample)
        weights = _weights(basis, fitter.sampled_coefficients(basis), self._usual_step)
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
        """Return coefficients (rows of the sample, channels) of all functions of time of a kind."""
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
        model = fitter.model_for(moved, sample.points, sample.order)
        limits = margins(entry, time, largest, fitter.residual_step)[sample.frames]
        residuals, _, _ = model.missing(limits, None, None, False, thread_count())
        near = np.ones(sample.frames.size, np.int64)

        ways = prediction_choices(residuals, sample.order.size)
        return min(_core.measure_residuals(residuals, sample.starts, way, near, sample.copies) for way in ways)
