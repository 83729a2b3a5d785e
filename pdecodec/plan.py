"""Choosing the model: no larger than the scene needs, by what each choice costs in estimated bits.

Piece lengths, alignment, the rate r, the quantisation step and the usual segment length are chosen once, on
a sample of the vertices over a few windows of the clip; segment lengths and alpha then follow the motion,
segment by segment. Every candidate is fitted, quantised and evaluated on the sample, and charged for its
coefficients and for the corrections that its misses would need.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pdecodec.coefficients import dequantise_segment
from pdecodec.corrections import correction_step
from pdecodec.curves import Curves
from pdecodec.elements import PIECE_POINTS, WHOLE_CURVE
from pdecodec.fit import ALPHAS, RATES, WORTHWHILE_GAIN, choose_alpha, fit_levels, fit_segment
from pdecodec.framewindow import checked_frames
from pdecodec.model import Model, ModelAlignment, SegmentCoefficients, build_model
from pdecodec.restshape import RestShape
from pdecodec.segments import Segment, terms_at
from pdecodec.sequence import MeshSequence
from pdecodec.settings import MAX_SEGMENT_FRAMES, PAPER_SEGMENT_FRAMES, EncodeSettings

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

STEPS = (0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.7, 8.0)
"""Quantisation steps to choose from, in bounds."""

SEGMENT_FRAMES = (2, 3, 4, 5, 6, 8, 11, 16, 23, 32, 45, MAX_SEGMENT_FRAMES)
"""Segment lengths to choose from, each about 1.4 times the one before."""

PAPER_STEP = 2e-5
"""Quantisation step of an unbounded encode, over the scale: far below the model's own error."""

SAMPLE_RUN = 256
"""Longest stretch of one curve in the sample, and so the longest piece that is tried."""

SAMPLE_VERTICES = 400
"""Vertices that the plan is made from, for each level of effort."""

SEGMENT_SAMPLE_VERTICES = 240
"""Vertices that each segment's length and alpha are chosen from, for each level of effort."""

WINDOWS = 3
"""Windows of the clip that the plan is made from: its beginning, middle and end."""

WINDOW_FRAMES = 32
"""Frames of a window, and so the longest usual segment; single segments may still grow longer."""

LEVEL_OFFSETS = (-2, 0, 2)
"""Piece lengths tried for each curve: half the usual, the usual, double."""

LEVELS_FROM_EFFORT = 4
"""Least effort at which curves get piece lengths of their own."""

START = {"level": PIECE_POINTS.index(64), "frames": SEGMENT_FRAMES.index(8), "step": STEPS.index(2.0)}
"""Where the search begins: the middle of what real clips ask for."""

BITS_OF_ZERO = 0.4
BITS_OF_LEVEL = 2.1
BITS_PER_DOUBLING = 1.6
"""Estimated cost of a quantised coefficient: of any, what a level of one costs more, and each doubling of it."""

BITS_OF_PLACE = 10.0
"""Estimated cost of saying which vertex a correction is for."""

ALIGNMENTS: tuple[ModelAlignment, ...] = ("affine", "none", "rotation")
"""In the order they are tried."""


@dataclass(frozen=True)
class Plan:
    """What was chosen.

    Attributes
    ----------
    alignment : {"none", "affine", "rotation"}
    level : int
        Usual piece length, see :data:`pdecodec.elements.PIECE_POINTS`.
    r : float
    step : float
        Quantisation step of the coefficients, over the bound (over the scale without one).
    frames : int
        Usual frames of a segment.
    """

    alignment: ModelAlignment
    level: int
    r: float
    step: float
    frames: int


@dataclass(frozen=True, eq=False)
class Sample:
    """Some vertices, as a small clip of their own.

    Attributes
    ----------
    vertices : (n,) int32
        Their indices in the mesh.
    curves : Curves
        Stretches of the mesh's curves; indices into `vertices`.
    rest : RestShape
        Of these vertices.
    """

    vertices: NDArray[np.int32]
    curves: Curves
    rest: RestShape


def take_sample(curves: Curves, rest: RestShape, size: int, run: int = SAMPLE_RUN) -> Sample:
    """Stretches of curves spread evenly over the mesh, about `size` vertices together.

    Parameters
    ----------
    curves : Curves
    rest : RestShape
    size : int
    run : int
        Longest stretch.
    """
    pieces = -(-curves.lengths // run)
    owner = np.repeat(np.arange(curves.count), pieces)
    index = np.arange(owner.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    begins = curves.starts[owner] + index * run
    ends = np.minimum(begins + run, curves.starts[owner + 1])
    every = max(1, round(curves.order.size / size))
    chosen = np.arange(min(every // 2, begins.size - 1), begins.size, every)
    places = np.concatenate([np.arange(begins[k], ends[k]) for k in chosen])
    starts = np.concatenate([[0], np.cumsum(ends[chosen] - begins[chosen])]).astype(np.int64)
    vertices = curves.order[places]
    within = Curves(np.arange(vertices.size, dtype=np.int32), starts)
    return Sample(vertices, within, RestShape(rest.levels[vertices], rest.origin, rest.step))


def make_plan(
    sequence: MeshSequence,
    curves: Curves,
    rest: RestShape,
    settings: EncodeSettings,
    *,
    bound: float | None,
) -> Plan:
    """Choose the model of a clip.

    Parameters
    ----------
    sequence : MeshSequence
    curves : Curves
    rest : RestShape
        Decoded.
    settings : EncodeSettings
        What they fix is not searched.
    bound : float or None [scene units]
    """
    sample = take_sample(curves, rest, SAMPLE_VERTICES * settings.effort, _longest_run(curves, settings))
    windows = _read_windows(sequence, sample.vertices)
    if bound is None:
        plan = Plan("rotation" if settings.alignment == "auto" else settings.alignment, 0, 0.0, PAPER_STEP, 0)
        plan = replace(plan, level=_fixed_level(settings), frames=settings.segment_frames or PAPER_SEGMENT_FRAMES)
        rates = RATES if settings.r is None else (settings.r,)
        errors = [_squared_error(windows, sample_model(sample, replace(plan, r=r)), plan.frames) for r in rates]
        plan = replace(plan, r=rates[int(np.argmin(errors))])
    else:
        plan = _search(windows, sample, settings, bound)
    return plan


def take_segment_sample(curves: Curves, rest: RestShape, plan: Plan, settings: EncodeSettings) -> Sample:
    """The vertices that each segment's length and alpha are chosen from: pieces spread over the mesh."""
    run = _longest_run(curves, settings) if plan.level == WHOLE_CURVE else PIECE_POINTS[plan.level]
    return take_sample(curves, rest, SEGMENT_SAMPLE_VERTICES * settings.effort, run)


def _longest_run(curves: Curves, settings: EncodeSettings) -> int:
    # The paper's curves are whole: so is its sample.
    return int(curves.lengths.max()) if settings.profile == "paper" else SAMPLE_RUN


def _fixed_level(settings: EncodeSettings) -> int:
    if settings.piece_points is None:
        return WHOLE_CURVE
    return int(np.searchsorted(PIECE_POINTS, settings.piece_points))


def sample_model(sample: Sample, plan: Plan) -> Model:
    levels = np.full(sample.curves.count, plan.level)
    return build_model(sample.curves, levels, sample.rest, r=plan.r, alignment=plan.alignment)


Window = tuple[int, Float32Array, Float64Array]
"""First frame, (frames, sample vertices, 3) positions, (frames,) times of a window."""


def _read_windows(sequence: MeshSequence, vertices: NDArray[np.int32], frames: int = WINDOW_FRAMES) -> list[Window]:
    size = min(frames, sequence.frame_count)
    latest = sequence.frame_count - size
    windows = []
    for first in sorted({latest * k // (WINDOWS - 1) for k in range(WINDOWS)}):
        block = sequence.frames_per_block
        parts = [
            checked_frames(sequence, at, min(at + block, first + size))[:, vertices]
            for at in range(first, first + size, block)
        ]
        windows.append((first, np.concatenate(parts), sequence.times[first : first + size]))
    return windows


def _squared_error(windows: Sequence[Window], model: Model, frames: int) -> float:
    total = 0.0
    for first, points, times in windows:
        segment = Segment(first, times[:frames], choose_alpha(points[:frames], model, first, times[:frames]))
        found = fit_segment(points[:frames], model, segment)
        decoded = _decode(model, segment, found)
        total += float(((decoded - points[:frames].astype(np.float64)) ** 2).sum())
    return total


def _decode(model: Model, segment: Segment, coefficients: SegmentCoefficients) -> Float32Array:
    return model.evaluate(terms_at([segment], segment.times), segment.frames, lambda _: coefficients)


def _search(windows: Sequence[Window], sample: Sample, settings: EncodeSettings, bound: float) -> Plan:
    """Coordinate descent over the choices, each a walk downhill along its list."""
    fixed_alignment = {"auto": None, "none": "none", "affine": "affine", "rotation": "rotation"}[settings.alignment]
    alphas = (0.0,) if settings.alpha is None else (settings.alpha,)
    longest = len(windows[0][2])
    lengths = [index for index, frames in enumerate(SEGMENT_FRAMES) if frames <= longest] or [0]
    levels = [index for index, points in enumerate(PIECE_POINTS) if points <= SAMPLE_RUN] + [WHOLE_CURVE]
    models: dict[tuple[ModelAlignment, int, float], Model] = {}
    costs: dict[Plan, float] = {}

    def cost(plan: Plan) -> float:
        if plan not in costs:
            key = (plan.alignment, plan.level, plan.r)
            if key not in models:
                models[key] = sample_model(sample, plan)
            frames = min(plan.frames, longest)
            bits = _bits_of_windows(windows, models[key], plan, frames, bound, alphas)
            costs[plan] = float(bits.sum()) / frames
        return costs[plan]

    plan = Plan(
        fixed_alignment or ALIGNMENTS[0],  # type: ignore[arg-type]
        START["level"] if settings.piece_points is None else _fixed_level(settings),
        settings.r or 0.0,
        STEPS[START["step"]],
        settings.segment_frames or SEGMENT_FRAMES[min(START["frames"], lengths[-1])],
    )
    for _ in range(1 if settings.effort < 4 else 2 if settings.effort < 8 else 3):
        before = plan
        if settings.segment_frames is None:
            plan = _walk(plan, "frames", [SEGMENT_FRAMES[index] for index in lengths], cost)
        if settings.piece_points is None:
            plan = _walk(plan, "level", levels, cost)
        plan = _walk(plan, "step", STEPS, cost)
        if fixed_alignment is None:
            plan = min((replace(plan, alignment=alignment) for alignment in ALIGNMENTS), key=cost)
        if settings.r is None and settings.effort > 1:
            plan = _walk(plan, "r", RATES, cost)
        if plan == before:
            break
    return plan


def _bits_of_windows(
    windows: Sequence[Window], model: Model, plan: Plan, frames: int, bound: float, alphas: Sequence[float]
) -> Float64Array:
    total = np.zeros(model.elements.count)
    for first, points, times in windows:
        total += estimate_bits(points[:frames], model, first, times[:frames], plan.step * bound, bound, alphas)[0]
    return total


def choose_levels(
    sequence: MeshSequence,
    curves: Curves,
    rest: RestShape,
    plan: Plan,
    settings: EncodeSettings,
    *,
    bound: float | None,
) -> NDArray[np.int64]:
    """Piece length of each curve: the plan's, or longer or shorter where its motion asks for it.

    Measured on all vertices over one segment in each window.

    Returns
    -------
    (curves,) int64
        Levels, see :data:`pdecodec.elements.PIECE_POINTS`.
    """
    usual = np.full(curves.count, plan.level, np.int64)
    if bound is None or settings.piece_points is not None or settings.effort < LEVELS_FROM_EFFORT or curves.count == 1:
        return usual
    every_vertex = np.arange(curves.order.size, dtype=np.int32)
    windows = _read_windows(sequence, every_vertex, plan.frames)
    alphas = (0.0,) if settings.alpha is None else (settings.alpha,)
    tried = sorted({min(max(plan.level + offset, 0), WHOLE_CURVE) for offset in LEVEL_OFFSETS})
    costs = []
    for level in tried:
        model = build_model(curves, np.full(curves.count, level), rest, r=plan.r, alignment=plan.alignment)
        bits = _bits_of_windows(windows, model, plan, plan.frames, bound, alphas)
        costs.append(np.bincount(model.elements.curve_of, bits, minlength=curves.count))
    # Ties (curves shorter than the pieces) go to the usual length, and then its index costs nothing.
    costs[tried.index(plan.level)] *= 1.0 - WORTHWHILE_GAIN
    return np.array(tried)[np.argmin(costs, axis=0)]


def _walk(plan: Plan, name: str, options: Sequence[float], cost: Callable[[Plan], float]) -> Plan:
    """Walk from the present option to its neighbours while that costs less."""
    index = options.index(getattr(plan, name))
    for direction in (1, -1):
        while 0 <= index + direction < len(options):
            candidate = replace(plan, **{name: options[index + direction]})
            if cost(candidate) >= cost(plan):
                break
            plan, index = candidate, index + direction
    return plan


def estimate_bits(
    points: Float32Array,
    model: Model,
    first: int,
    times: Float64Array,
    step: float,
    bound: float,
    alphas: Sequence[float] = ALPHAS,
) -> tuple[Float64Array, float]:
    """Estimated bits of each element of one segment, and the alpha they are for.

    Parameters
    ----------
    points : (frames, vertices, 3) float32
    model : Model
    first : int
    times : (frames,) float64 [s]
    step, bound : float [scene units]
    alphas : sequence of float
        To choose from.

    Returns
    -------
    bits : (elements,) float64
    alpha : float
    """
    alpha = choose_alpha(points, model, first, times, alphas)
    segment = Segment(first, times, alpha)
    levels = fit_levels(points, model, segment, step)
    elements = model.elements
    bits = np.add.reduceat(_level_bits(levels.shape).sum(axis=1), elements.column_starts[:-1])
    if model.posed_elements:
        bits += _level_bits(np.diff(levels.poses, axis=0, prepend=0)).sum(axis=1)
    decoded = _decode(model, segment, dequantise_segment(levels, model, step))
    residual = points.astype(np.float64) - decoded
    x, y, z = residual[..., 0], residual[..., 1], residual[..., 2]
    beyond = x * x + y * y + z * z > bound * bound
    corrections = _level_bits(np.rint(residual[beyond] / correction_step(bound, 0.0))).sum(axis=1)
    of_vertex = np.bincount(np.nonzero(beyond)[1], BITS_OF_PLACE + corrections, minlength=points.shape[1])
    return bits + np.add.reduceat(of_vertex[elements.order], elements.starts[:-1]), alpha


def _level_bits(levels: NDArray[np.floating] | NDArray[np.integer]) -> Float64Array:
    """Estimated bits of each level."""
    # frexp instead of a logarithm: exact, so that the choice is the same on every machine.
    fraction, exponent = np.frexp(np.abs(levels).astype(np.float64))
    doublings = exponent + 2.0 * fraction - 2.0
    return np.where(levels == 0, BITS_OF_ZERO, BITS_OF_ZERO + BITS_OF_LEVEL + BITS_PER_DOUBLING * doublings)


def choose_segment(
    points: Float32Array,
    model: Model,
    first: int,
    times: Float64Array,
    usual: int,
    plan: Plan,
    settings: EncodeSettings,
    bound: float | None,
) -> Segment:
    """The next segment: as long as pays, shorter where the motion asks for it.

    Parameters
    ----------
    points : (frames, sample vertices, 3) float32
        The frames to come, as many as a segment may have.
    model : Model
        Of the sample.
    first : int
        Index of the first of these frames.
    times : (frames,) float64 [s]
    usual : int
        Length to try first: that of the segment before.
    plan : Plan
    settings : EncodeSettings
    bound : float or None [scene units]
    """
    alphas = ALPHAS if settings.alpha is None else (float(np.float32(settings.alpha)),)
    available = len(times)
    if bound is None or settings.segment_frames is not None:
        frames = min(plan.frames, available)
        return Segment(first, times[:frames], choose_alpha(points[:frames], model, first, times[:frames], alphas))
    step, found = plan.step * bound, {}

    def cost(frames: int) -> float:
        if frames not in found:
            bits, alpha = estimate_bits(points[:frames], model, first, times[:frames], step, bound, alphas)
            found[frames] = float(bits.sum()) / frames, alpha
        return found[frames][0]

    options = sorted({min(frames, available) for frames in SEGMENT_FRAMES})
    index = int(np.searchsorted(options, min(usual, available)))
    for direction in (1, -1):
        while 0 <= index + direction < len(options) and cost(options[index + direction]) < cost(options[index]):
            index += direction
    cost(options[index])
    return Segment(first, times[: options[index]], found[options[index]][1])
