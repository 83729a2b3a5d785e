"""Choosing the model: no larger than the scene needs, by what each choice costs in estimated bits.

Piece lengths, alignment, the rate r, the quantisation step and the usual segment length are chosen once, on
a sample of the vertices over a few windows of the clip; segment lengths and alpha then follow the motion
(:mod:`pdecodec.segmentation`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pdecodec.cost import estimate_bits, squared_error
from pdecodec.curves import Curves
from pdecodec.elements import PIECE_POINTS, WHOLE_CURVE
from pdecodec.errors import SettingsError
from pdecodec.fit import RATES
from pdecodec.model import Model, ModelAlignment, build_model
from pdecodec.restshape import RestShape
from pdecodec.sampling import Sample, Window, read_windows, take_sample
from pdecodec.sequence import MeshSequence
from pdecodec.settings import MAX_SEGMENT_FRAMES, PAPER_SEGMENT_FRAMES, EncodeSettings

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

WINDOW_FRAMES = 32
"""Frames of a window, and so the longest usual segment; single segments may still grow longer."""

LEVEL_OFFSETS = (-2, 0, 2)
"""Piece lengths tried for each curve: half the usual, the usual, double."""

LEVELS_FROM_EFFORT = 4
"""Least effort at which curves get piece lengths of their own."""

LEVEL_POSITIONS = 2**20
"""Positions (vertices times frames) that curves' piece lengths are chosen from: a large mesh gets one window."""

START_LEVEL = PIECE_POINTS.index(64)
START_FRAMES = 8
START_STEP = 2.0
"""Where the search begins: the middle of what real clips ask for."""

ALIGNMENTS_TO_TRY: tuple[ModelAlignment, ...] = ("affine", "none", "rotation")
"""In the order they are tried; ties go to the earlier."""

PAPER_ALIGNMENTS: tuple[ModelAlignment, ...] = ("none", "rotation")
"""The same for profile "paper", whose functions leave no place for the affine four."""

WORTHWHILE_ROTATION = 0.8
"""Share of the squared error that a rotation may leave under profile "paper" to be worth its numbers."""

WORTHWHILE_SHARE = 1e-9
"""Share of its bits by which another piece length must win, so that rounding does not choose."""


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
    sample = take_sample(curves, rest, SAMPLE_VERTICES * settings.effort, longest_run(curves, settings))
    windows = read_windows(sequence, sample.vertices, WINDOW_FRAMES)
    if settings.profile == "paper":
        return _paper_plan(windows, sample, settings, step=PAPER_STEP if bound is None else START_STEP)
    if bound is None:
        raise SettingsError("without a bound there is nothing to choose the model by; give a tolerance")
    return _search(windows, sample, settings, bound)


def _paper_plan(windows: Sequence[Window], sample: Sample, settings: EncodeSettings, *, step: float) -> Plan:
    """The paper's model: whole curves, fixed segments, alignment and r by what they leave over.

    Not r = 0: there the functions of Eq. 18 are dependent, and the file's would not be the paper's. Not always the
    rotation of Eqs. 19 to 23: of a curve that is straight at some frame it is chance how it turns about itself.
    """
    plan = Plan(
        alignment="none" if settings.alignment == "auto" else settings.alignment,
        level=_fixed_level(settings),
        r=0.0,
        step=step,
        frames=settings.segment_frames or PAPER_SEGMENT_FRAMES,
    )
    rates = RATES[1:] if settings.r is None else (settings.r,)
    alignments = PAPER_ALIGNMENTS if settings.alignment == "auto" else (plan.alignment,)
    plans = [replace(plan, alignment=alignment, r=r) for alignment in alignments for r in rates]
    heads = [window.head(plan.frames) for window in windows]
    models = [sample_model(sample, item) for item in plans]
    errors = [sum(squared_error(head, model) for head in heads) for model in models]
    errors = [
        error if item.alignment == "none" else error / WORTHWHILE_ROTATION
        for item, error in zip(plans, errors, strict=True)
    ]
    return plans[int(np.argmin(errors))]


def _fixed_level(settings: EncodeSettings) -> int:
    if settings.piece_points is None:
        return WHOLE_CURVE
    return int(np.searchsorted(PIECE_POINTS, settings.piece_points))


def sample_model(sample: Sample, plan: Plan) -> Model:
    levels = np.full(sample.curves.count, plan.level)
    return build_model(sample.curves, levels, sample.rest, r=plan.r, alignment=plan.alignment)


def _search(windows: Sequence[Window], sample: Sample, settings: EncodeSettings, bound: float) -> Plan:
    """Coordinate descent over the choices, each a walk downhill along its list."""
    longest = len(windows[0].times)
    alphas = (0.0,) if settings.alpha is None else (settings.alpha,)
    models: dict[tuple[ModelAlignment, int, float], Model] = {}
    costs: dict[Plan, float] = {}

    def cost(plan: Plan) -> float:
        if plan not in costs:
            key = (plan.alignment, plan.level, plan.r)
            if key not in models:
                models[key] = sample_model(sample, plan)
            costs[plan] = float(_bits_per_frame(windows, models[key], plan, bound, alphas).sum())
        return costs[plan]

    plan = Plan(
        alignment=ALIGNMENTS_TO_TRY[0] if settings.alignment == "auto" else settings.alignment,
        level=START_LEVEL if settings.piece_points is None else _fixed_level(settings),
        r=settings.r or 0.0,
        step=START_STEP,
        frames=settings.segment_frames or min(START_FRAMES, longest),
    )
    lengths = sorted({min(frames, longest) for frames in SEGMENT_FRAMES})
    levels = [level for level, points in enumerate(PIECE_POINTS) if points <= SAMPLE_RUN] + [WHOLE_CURVE]
    for _ in range(1 + settings.effort // 4):
        before = plan
        if settings.segment_frames is None:
            plan = _walk(plan, [replace(plan, frames=frames) for frames in lengths], cost)
        if settings.piece_points is None:
            plan = _walk(plan, [replace(plan, level=level) for level in levels], cost)
        plan = _walk(plan, [replace(plan, step=step) for step in STEPS], cost)
        if settings.alignment == "auto":
            plan = min((replace(plan, alignment=alignment) for alignment in ALIGNMENTS_TO_TRY), key=cost)
        if settings.r is None and settings.effort > 1:
            plan = _walk(plan, [replace(plan, r=r) for r in RATES], cost)
        if plan == before:
            break
    return plan


def _walk(plan: Plan, line: Sequence[Plan], cost: Callable[[Plan], float]) -> Plan:
    """Walk from `plan` along a line of plans that it is on, while the next one costs less."""
    index = line.index(plan)
    for direction in (1, -1):
        while 0 <= index + direction < len(line) and cost(line[index + direction]) < cost(line[index]):
            index += direction
    return line[index]


def _bits_per_frame(
    windows: Sequence[Window], model: Model, plan: Plan, bound: float, alphas: Sequence[float]
) -> Float64Array:
    """(elements,) estimated bits of one segment in each window, over its frames."""
    total = np.zeros(model.elements.count)
    for window in windows:
        head = window.head(plan.frames)
        total += estimate_bits(head, model, plan.step * bound, bound, alphas)[0] / len(head.times)
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

    Measured on all vertices over one segment in each of up to three windows.

    Returns
    -------
    (curves,) int64
        Levels, see :data:`pdecodec.elements.PIECE_POINTS`.
    """
    usual = np.full(curves.count, plan.level, np.int64)
    is_fixed = settings.profile == "paper" or settings.piece_points is not None
    if bound is None or is_fixed or settings.effort < LEVELS_FROM_EFFORT or curves.count == 1:
        return usual
    every_vertex = np.arange(curves.order.size, dtype=np.int32)
    windows = read_windows(sequence, every_vertex, plan.frames, LEVEL_POSITIONS // (plan.frames * every_vertex.size))
    alphas = (0.0,) if settings.alpha is None else (settings.alpha,)
    tried = sorted({min(max(plan.level + offset, 0), WHOLE_CURVE) for offset in LEVEL_OFFSETS})
    costs: list[Float64Array] = []
    for level in tried:
        model = build_model(curves, np.full(curves.count, level), rest, r=plan.r, alignment=plan.alignment)
        bits = _bits_per_frame(windows, model, plan, bound, alphas)
        costs.append(np.bincount(model.elements.curve_of, bits, minlength=curves.count).astype(np.float64))
    # Ties (curves shorter than the pieces) go to the usual length, and then its index costs nothing.
    costs[tried.index(plan.level)] = costs[tried.index(plan.level)] * (1.0 - WORTHWHILE_SHARE)
    chosen: NDArray[np.int64] = np.array(tried)[np.argmin(costs, axis=0)]
    return chosen


def longest_run(curves: Curves, settings: EncodeSettings) -> int:
    """Longest stretch of a curve in a sample: the paper's curves are whole, and so is their sample."""
    return int(curves.lengths.max()) if settings.profile == "paper" else SAMPLE_RUN
