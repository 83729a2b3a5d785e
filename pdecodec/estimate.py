"""What ways to encode a group of frames would take, on large meshes without fitting all of it.

Functions of time are coded once and their bits at other steps follow from that. Coefficients and residuals are those of
some elements from all over the mesh, and counted as many times as those are part of it. Small meshes, where that is
quick, are fitted in full.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pdecodec import _core
from pdecodec.displacements import Displacements, TimeFunctions, time_basis_of
from pdecodec.groupfit import (
    GroupChoice,
    GroupFitter,
    axes_of,
    cosines_needed,
    grid_step,
    needed_functions,
    quantise_sparsely,
)
from pdecodec.groups import GroupEntry, functions_of_time, group_functions, margins
from pdecodec.residuals import residual_ways
from pdecodec.shares import thread_count
from pdecodec.spacebasis import SpaceBasis

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]

SAMPLED_SHARE, FEWEST_VERTICES = 1 / 8, 1024
"""Of a larger mesh, elements are looked at that have this share of the vertices, and so many at least."""


class BitCounter(Protocol):
    """Counts what a group takes in one space basis."""

    def bits(self, choice: GroupChoice) -> float:
        """What a group takes that way, about or exactly."""

    def prepare(self, choice: GroupChoice) -> None:
        """Compute what choices of a time basis and origin share: calls in several threads would each do it."""


def bit_counter(fitter: GroupFitter, basis: SpaceBasis, like: BitCounter | None = None) -> BitCounter:
    """Fits of all of a small mesh, estimates of a large one."""
    if not fitter.is_large:
        return FitCounter(fitter, basis)
    return Estimate(fitter, basis, like if isinstance(like, Estimate) else None)


class FitCounter:
    """What full fits take."""

    def __init__(self, fitter: GroupFitter, basis: SpaceBasis) -> None:
        self._fitter, self._basis = fitter, basis

    def prepare(self, choice: GroupChoice) -> None:
        self._fitter.prepare(choice)

    def bits(self, choice: GroupChoice) -> float:
        return self._fitter.fit(self._basis, choice).bits


class _Sample:
    """Some elements of a space basis: of those that take little as of those that take much.

    Parameters
    ----------
    points : (frames, vertices, 3) float32 [scene units]
    basis : SpaceBasis
    coefficients : (functions of space, channels) float64
        In any functions of time.
    step : float
        Their quantisation step.
    elements : (n,) int64, optional
        Chosen here where there are none.

    Attributes
    ----------
    elements : (n,) int64
    vertices : (m,) int32
        Theirs, element after element.
    starts : (n + 1,) int64
        Of each element among the vertices.
    order : (m,) int32
        The vertices' places: as they stand.
    points : (frames, m, 3) float32 [scene units]
    copies, weight : float
        How many times as many vertices the mesh has, and how many times as much all elements' coefficients take, about.
    rows : (k,) int64
        Functions of space that are not of other elements.
    subbands : (starts, kinds, parents)
        Of these; see :attr:`pdecodec.spacebasis.SpaceBasis.subbands`.
    """

    def __init__(
        self,
        points: Float32Array,
        basis: SpaceBasis,
        coefficients: Float64Array,
        step: float,
        elements: Int64Array | None,
    ) -> None:
        vertices, count = basis.order.size, basis.element_count
        # About what each element takes: some of them take many times as much as others.
        rough = np.log2(1.0 + np.square(coefficients / step)).sum(axis=1)
        weights = np.add.reduceat(np.append(rough, 0.0), basis.coefficient_starts[:-1])
        weights[np.diff(basis.coefficient_starts) == 0] = 0.0
        if elements is None:
            share = min(max(SAMPLED_SHARE, FEWEST_VERTICES / vertices), 1.0)
            sampled = max(1, round(share * count))
            places = ((np.arange(sampled) + 0.5) * count / sampled).astype(np.int64)
            elements = np.sort(np.argsort(weights, kind="stable")[places])
        self.elements = elements
        self.starts = np.concatenate([[0], np.cumsum(np.diff(basis.starts)[elements])])
        self.vertices = np.concatenate([basis.order[basis.starts[e] : basis.starts[e + 1]] for e in elements])
        self.order = np.arange(self.vertices.size, dtype=np.int32)
        self.points = np.ascontiguousarray(points[:, self.vertices])
        self.copies = vertices / self.vertices.size
        some = float(weights[elements].sum())
        self.weight = float(weights.sum()) / some if some else 1.0
        starts, kinds, parents = basis.subbands
        nodes = kinds.size - count
        subbands = np.concatenate([np.arange(nodes), nodes + elements])
        sizes = np.diff(starts)[subbands]
        self.subbands = np.concatenate([[0], np.cumsum(sizes)]), kinds[subbands], parents[subbands]
        self.rows = np.repeat(starts[subbands] - self.subbands[0][:-1], sizes) + np.arange(sizes.sum())


class Estimate:
    """Estimates from some elements of the mesh.

    Parameters
    ----------
    fitter : GroupFitter
        Of the whole mesh.
    basis : SpaceBasis
    like : Estimate, optional
        Of the same points from another reference frame, whose elements are taken again.
    """

    def __init__(self, fitter: GroupFitter, basis: SpaceBasis, like: Estimate | None = None) -> None:
        self._fitter, self._basis = fitter, basis
        usual = fitter.first_choice
        self._usual_step = grid_step(usual.step)
        moved = fitter.displacements(usual.origin)
        values = basis.project(moved.coefficients(usual.time))
        elements = like._sample.elements if like and like._basis.element_count == basis.element_count else None
        self._sample: _Sample = _Sample(fitter.points, basis, values, self._usual_step, elements)
        rows: Float64Array = values[self._sample.rows]
        self._coefficients: dict[tuple[Displacements, TimeFunctions], Float64Array] = {(moved, usual.time): rows}

    def prepare(self, choice: GroupChoice) -> None:
        moved = self._fitter.displacements(choice.origin)
        self._projected(moved, choice.time)
        if choice.time != "cosines":
            moved.time_cost(choice.time, self._usual_step)

    def _projected(self, moved: Displacements, time: TimeFunctions) -> Float64Array:
        """Coefficients (rows of the sample, channels) of all functions of time of a kind."""
        if (moved, time) not in self._coefficients:
            self._coefficients[moved, time] = self._basis.project(moved.coefficients(time))[self._sample.rows]
        return self._coefficients[moved, time]

    def bits(self, choice: GroupChoice) -> float:
        sample, axes, step = self._sample, axes_of(choice.time), grid_step(choice.step)
        moved, frames = self._fitter.displacements(choice.origin), self._fitter.frames
        quantised, largest = quantise_sparsely(self._projected(moved, choice.time), step, axes)
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
        coefficient_bits = (
            _core.measure_coefficients(quantised, *sample.subbands, axes, sample.weight) if count else 0.0
        )
        return time_bits + coefficient_bits + self._residual_bits(entry, functions, quantised, largest)

    def _residual_bits(
        self, entry: GroupEntry, functions: Float64Array, quantised: Int64Array, largest: Int64Array
    ) -> float:
        fitter, sample = self._fitter, self._sample
        time = functions_of_time(entry, functions, fitter.times)
        everywhere = np.zeros((self._basis.functions, entry.width), np.int64)
        everywhere[sample.rows] = quantised
        moved = group_functions(entry, time, everywhere, self._basis, sample.elements)
        model = fitter.held(moved, sample.points, sample.order)
        limits = margins(entry, time, largest, fitter.residual_step)
        residuals = model.missing(limits, None, None, thread_count())
        near = np.ones(entry.frames, np.int64)

        ways = residual_ways(residuals, sample.order.size)
        return min(_core.measure_residuals(residuals, sample.starts, way, near, sample.copies) for way in ways)
