"""Read how a file was encoded: its bound, and the alternatives to the encoder's choices."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pdecodec.codec.decoder import Animation
from pdecodec.codec.encode.report import GENERATOR, Question
from pdecodec.codec.run_encoder import make_encoder
from pdecodec.codec.sections.residuals import LAST_BINADE, SAFETY
from pdecodec.codec.settings import SMALLEST_BOUND, EncodeSettings
from pdecodec.errors import InputError, SettingsError
from pdecodec.mesh.sequence import ArraySequence, MeshObject

COMPARED_FRAMES = 96
"""First frames at most that are encoded again to find out what else there was."""


def bound_of(animation: Animation) -> float | None:
    """The bound [scene units] that a file was encoded with, or a little less; None where it says that there was none.

    What its step of residuals keeps, where a single bound has that step. Where float32 is so coarse that all bounds
    below some have the same, what the file's remarks say; without them it may have been the least one there is.
    """
    reference, _ = animation.reference_and_space()
    points, farthest = reference.points, reference.farthest
    largest = float(np.abs(points).max())
    near, far = (
        float(np.spacing(np.float32(min(max(0.0, largest + more), LAST_BINADE)))) for more in (-farthest, farthest)
    )
    # Undoes pdecodec.codec.sections.residuals.residual_step.
    of_step = math.sqrt(3.0) / 2.0 * (animation.residual_step / SAFETY + near)
    settings, is_alone = _recorded(animation), animation.residual_step > far / 4.0
    if settings is None:
        return of_step if is_alone else SMALLEST_BOUND
    diagonal = math.hypot(*np.ptp(points, axis=0).tolist())
    said = settings.bound(max(0.0, diagonal - 2.0 * math.sqrt(3.0) * farthest))
    if said is None:
        return None
    # A tolerance is of a diagonal that is only about known here.
    return of_step if is_alone and settings.max_error is None else min(said, of_step)


def _recorded(animation: Animation) -> EncodeSettings | None:
    """The settings that a file's remarks say it was made with, if they do."""
    information = animation.info()
    if not information["generator"].startswith(GENERATOR):
        return None  # Of settings, those that are as usual are not recorded: others' remarks would say the usual ones.
    try:
        return EncodeSettings.from_json(information["settings"])
    except (SettingsError, TypeError):
        return None


def alternatives_of(animation: Animation) -> list[Question]:
    """Return the alternatives that an encoder compares in the first frames: it encodes the decoded frames again.

    Raises
    ------
    InputError
        If it has several runs of frames.
    """
    if len(animation.runs) > 1:
        raise InputError(
            "has several runs of frames, which are encoded each by itself",
            code="unsupported-feature",
            path=animation.path,
        )
    bound = bound_of(animation)
    settings = _recorded(animation) or EncodeSettings()
    if bound is None or settings.profile == "paper":
        return []
    frames = min(animation.frame_count, COMPARED_FRAMES)
    parts = [MeshObject(item.name, item.connectivity) for item in animation.objects]
    first = ArraySequence(animation.read_frames(0, frames), objects=parts, times=animation.times[:frames])
    chosen = replace(settings, tolerance=None, max_error=bound, why=True)
    return list(make_encoder(first, chosen, None).run(None, overwrite=False).alternatives)
