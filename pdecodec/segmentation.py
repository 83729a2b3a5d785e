"""Cutting a clip into time segments: as long as pays, shorter where the motion asks for it."""

from __future__ import annotations

import numpy as np

from pdecodec.cost import estimate_bits
from pdecodec.curves import Curves
from pdecodec.elements import PIECE_POINTS, WHOLE_CURVE
from pdecodec.fit import ALPHAS, choose_alpha
from pdecodec.model import Model
from pdecodec.plan import SEGMENT_FRAMES, Plan, longest_run
from pdecodec.restshape import RestShape
from pdecodec.sampling import Sample, Window, take_sample
from pdecodec.segments import Segment
from pdecodec.settings import EncodeSettings

SEGMENT_SAMPLE_VERTICES = 240
"""Vertices that each segment's length and alpha are chosen from, for each level of effort."""


def take_segment_sample(curves: Curves, rest: RestShape, plan: Plan, settings: EncodeSettings) -> Sample:
    """The vertices that each segment's length and alpha are chosen from: pieces spread over the mesh."""
    run = longest_run(curves, settings) if plan.level == WHOLE_CURVE else PIECE_POINTS[plan.level]
    return take_sample(curves, rest, SEGMENT_SAMPLE_VERTICES * settings.effort, run)


def choose_segment(
    window: Window,
    model: Model,
    usual: int,
    plan: Plan,
    settings: EncodeSettings,
    bound: float | None,
) -> Segment:
    """The next segment: as long as pays, shorter where the motion asks for it.

    Parameters
    ----------
    window : Window
        The frames to come of the sample's vertices, as many as a segment may have.
    model : Model
        Of the sample.
    usual : int
        Length to try first: that of the segment before.
    plan : Plan
    settings : EncodeSettings
    bound : float or None [scene units]
    """
    is_paper = settings.profile == "paper"
    alphas: tuple[float, ...] = ALPHAS[1:] if is_paper else ALPHAS  # at 0 the functions of Eq. 12 are dependent
    if settings.alpha is not None:
        alphas = (float(np.float32(settings.alpha)),)  # as the file will have it
    available = len(window.times)
    if bound is None or is_paper or settings.segment_frames is not None:
        head = window.head(min(plan.frames, available))
        return Segment(head.first, head.times, choose_alpha(head, model, alphas))
    step = plan.step * bound
    found: dict[int, tuple[float, float]] = {}

    def cost(frames: int) -> float:
        if frames not in found:
            bits, alpha = estimate_bits(window.head(frames), model, step, bound, alphas)
            found[frames] = float(bits.sum()) / frames, alpha
        return found[frames][0]

    options = sorted({min(frames, available) for frames in SEGMENT_FRAMES})
    index = int(np.searchsorted(options, min(usual, available)))
    for direction in (1, -1):
        while 0 <= index + direction < len(options) and cost(options[index + direction]) < cost(options[index]):
            index += direction
    frames = options[index]
    cost(frames)
    return Segment(window.first, window.times[:frames], found[frames][1])
