"""Profile "paper": the model of Fang et al. 2024, section 4, as a codec.

Whole curves (or pieces), segments of a fixed number of frames, and on each curve, axis and segment 32 coefficients:
4 functions of time (Eq. 12) times 8 of space (Eqs. 14 and 16). The functions are a tensor product, and both factors
are orthonormal here, so that the least squares of Eq. 25 is one projection in time and one in space.

It departs from the paper in three ways. It fits the displacement from a reference frame, because eight functions
cannot carry the shape of a long curve. It does not compute the parameter u by Eq. 24, which needs the positions that
are to be decoded. It does not remove rotations (Eqs. 19 to 23), because they would have to be stored.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pdecodec import _core
from pdecodec.codec.encode.fit import EncodedGroup, FittedGroup, GroupFitter, QuantisedGroup
from pdecodec.codec.encode.pipeline import FINEST_STEP, Encoder
from pdecodec.codec.encode.quantise import QUARTERS, quantise
from pdecodec.codec.encode.report import ask
from pdecodec.codec.encode.temporal import FARTHEST_STEPS
from pdecodec.codec.encode.tuning import Tuning
from pdecodec.codec.linear_algebra import product
from pdecodec.codec.sections.bytestream import LARGEST
from pdecodec.codec.sections.closed_form import SPACE_FUNCTIONS, TIME_FUNCTIONS, ClosedForm
from pdecodec.codec.sections.groups import GroupEntry
from pdecodec.codec.sections.reference import quantise_reference
from pdecodec.codec.sections.space_basis import MAX_POINTS, SpaceBasis, build_space_basis
from pdecodec.codec.settings import EncodeSettings
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.sequence import MeshSequence, Progress
from pdecodec.mesh.ties import TieFinder

ALPHAS = (1.5, 2.5, 3.5, 5.0, 7.0, 10.0)
"""Candidates for the rate of Eq. 12, over half a segment: at 3.14 sin and cos swing once over the segment."""

RATES = (1.5, 3.0, 5.0, 8.0)
"""Candidates for the rate r of Eqs. 14 and 16, over half a piece."""

STEPS = (0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 32.0, 64.0)
"""Candidates for the quantisation step if there is a bound, in units."""

SAMPLED_SEGMENTS = 3
"""Number of segments, spread over the clip, from which the rate r and the steps are chosen."""

WORTHWHILE_GAIN = 1e-9
"""Share of the energy that a larger rate must save, so that rounding errors do not decide."""

ADDED_BY_QUANTISATION = 0.01
"""Squared error that quantising coefficients may add, relative to the model's own: half a percent of the error."""

ADDED_BY_REFERENCE = 0.05
"""Largest error of the reference frame, relative to the model's own: in squares, it adds an eighth of a percent."""

STEP_RATIO = QUARTERS[1]
"""Ratio between quantisation steps that are tried in succession."""


@dataclass(frozen=True, eq=False)
class _Projected:
    """Displacements of a segment, projected onto functions of time and space.

    Attributes
    ----------
    alpha : float
    coefficients : (functions of space, 4 * 3) float64 [scene units]
    error : float [scene units^2]
        Sum of squares of the part that the functions do not describe.
    """

    alpha: float
    coefficients: Float64Array
    error: float


class PaperEncoder(Encoder):
    """Encoder of profile "paper"."""

    def __init__(self, sequence: MeshSequence, settings: EncodeSettings, progress: Progress | None) -> None:
        super().__init__(sequence, settings, progress)
        paper, self._rounded_up_at = settings.paper, Tuning().dead_zones[0][0]
        self._alphas: Sequence[float] = ALPHAS if paper.alpha is None else (paper.alpha,)
        sampled = [(self._read(*part), part) for part in self._sampled_segments()]
        self._show_all(self._first[np.newaxis], finder := TieFinder(self._first))
        self._ties = finder.ties
        finest = FINEST_STEP * self._scale
        fine = quantise_reference(self._first, finest)
        errors: dict[float, float] = {}
        for rate in RATES if paper.r is None else (paper.r,):
            basis = self._build(fine.grid, rate)
            errors[rate] = sum(self._project(points, part, basis, fine.points).error for points, part in sampled)
        self._rate = min(errors, key=lambda rate: errors[rate] * (1.0 + WORTHWHILE_GAIN * rate))
        positions = sum(len(points) for points, _ in sampled) * sequence.vertex_count
        rms = float(np.sqrt(errors[self._rate] / positions))
        step = max(2.0 * ADDED_BY_REFERENCE * rms, finest)  # The root mean square of rounding is about half a step.
        self._set_reference(step if self._bound is None else min(step, self._bound / 2.0))
        self._basis = self._build(self._reference.grid, self._rate)

    @property
    def _space(self) -> SpaceBasis:
        return self._basis

    def _build(self, grid: Int64Array, rate: float) -> SpaceBasis:
        """Return the functions of Eqs. 14 and 16 at a rate, on whole curves or pieces of them."""
        return build_space_basis(
            "curve",
            self._sequence.objects,
            grid,
            points=self._settings.paper.piece_points or MAX_POINTS["curve"],
            functions=SPACE_FUNCTIONS,
            rate=rate,
            affine=False,
            ties=self._ties,
        )

    def _segments(self) -> list[tuple[int, int]]:
        """Return first frame and end of each segment; a remainder too short for four functions joins the
        segment before.
        """
        frames, length = self._sequence.frame_count, self._settings.paper.segment_frames
        edges = [*range(0, frames, length), frames]
        if len(edges) > 2 and edges[-1] - edges[-2] < min(length, TIME_FUNCTIONS):
            del edges[-2]
        return list(itertools.pairwise(edges))

    def _sampled_segments(self) -> list[tuple[int, int]]:
        segments = self._segments()
        places = np.unique(np.linspace(0, len(segments) - 1, SAMPLED_SEGMENTS).astype(np.int64))
        return [segments[place] for place in places]

    def _project(
        self, points: Float32Array, part: tuple[int, int], basis: SpaceBasis, reference: Float64Array
    ) -> _Projected:
        """Solve the least squares of Eq. 25 for each alpha, for which they are linear; return the solution of
        smallest error.
        """
        moved = points.astype(np.float64) - reference
        if self._bound is not None:  # As in profile "auto", vertices beyond this distance are left to residuals.
            moved[np.abs(moved) > FARTHEST_STEPS * self._unit] = 0.0
        energy = _core.sum_of_products(moved.ravel(), moved.ravel())
        best: _Projected | None = None
        for alpha in self._alphas:
            functions = self._closed_form(part, alpha)
            weights = functions.weights(functions.times)
            # Eq. 25: both factors are orthonormal, so that its normal equations are these two projections.
            along = product(weights.T, moved.reshape(len(moved), -1)).reshape(-1, len(reference), 3).transpose(1, 0, 2)
            coefficients = basis.project(along.reshape(len(reference), -1))
            error = max(energy - _core.sum_of_products(coefficients.ravel(), coefficients.ravel()), 0.0)
            if best is None or error < best.error * (1.0 - WORTHWHILE_GAIN):
                best = _Projected(alpha, coefficients, error)
        assert best is not None  # There is at least one alpha.
        return best

    def _closed_form(self, part: tuple[int, int], alpha: float) -> ClosedForm:
        times = self._sequence.times[slice(*part)]
        return ClosedForm(times, alpha, min(TIME_FUNCTIONS, times.size))

    def _groups(self) -> Iterator[EncodedGroup]:
        for part in self._segments():
            points = self._read(*part)
            projected = self._project(points, part, self._basis, self._reference.points)
            fitter = GroupFitter(
                points,
                self._reference.points,
                self._first,
                times=self._sequence.times[slice(*part)],
                bound=np.inf if self._bound is None else self._bound,
                unit=self._unit,
                residual_step=self._residual_step,
                tuning=Tuning(),
            )
            if self._bound is None:
                fitted = self._quantised(fitter, projected, self._step(projected))
            else:
                tried = {step: self._quantised(fitter, projected, step * self._unit) for step in STEPS}
                best = min(tried, key=lambda step: tried[step].bits)
                fitted = tried[best]
                if self._settings.why and not self._questions:
                    ways = {f"{step:g} bounds": item.bits for step, item in tried.items()}
                    question = ask("step of coefficients", fitter.frames, ways, f"{best:g} bounds")
                    self._questions = [question] if question else []
            yield fitter.encode(fitted, self._basis)

    def _step(self, projected: _Projected) -> float:
        """Return the coarsest step at which rounding adds little to the model's own error."""
        coefficients = projected.coefficients
        largest = float(np.abs(coefficients).max(initial=0.0))
        step = max(self._unit, 2.0 * largest / LARGEST)
        allowed = ADDED_BY_QUANTISATION * projected.error
        while step < largest:
            coarser = step * STEP_RATIO
            off = coefficients - coarser * quantise(coefficients, coarser, self._rounded_up_at)
            if _core.sum_of_products(off.ravel(), off.ravel()) > allowed:
                break
            step = coarser
        return step

    def _quantised(self, fitter: GroupFitter, projected: _Projected, step: float) -> FittedGroup:
        quantised = quantise(projected.coefficients, step, self._rounded_up_at)
        entry = GroupEntry(
            frames=fitter.frames,
            functions=quantised.shape[1] // 3 if quantised.any() else 0,
            basis="closed form",
            single=False,
            step=step,
            alpha=projected.alpha,
        )
        return fitter.fitted(self._basis, QuantisedGroup(entry, None, quantised[:, : entry.width]))

    def _summary(self) -> str:
        groups = len(self._entries)
        frames = self._sequence.frame_count / groups
        where = self._where("curve" if self._settings.paper.piece_points is None else "piece", "s")
        return (
            f"closed form x curve: {TIME_FUNCTIONS} functions of time over {groups} groups of {frames:.0f} frames, "
            f"times {SPACE_FUNCTIONS} of space on {where}"
        )
