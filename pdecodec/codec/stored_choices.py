"""Find out how a file was encoded: its bound, and the alternatives to the encoder's choices."""

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
"""Largest number of frames, from the first, that are encoded again to find alternatives."""


def bound_of(animation: Animation) -> float | None:
    """Return the bound [scene units] that a file was encoded with, or a little less; None if it had none.

    Usually the step of residuals determines the bound. If float32 is so coarse that several bounds lead to the same
    step, the file's remarks state the bound; without remarks, the smallest of these bounds is returned.
    """
    reference, _ = animation.reference_and_space()
    points, farthest = reference.points, reference.farthest
    largest = float(np.abs(points).max())
    near, far = (
        float(np.spacing(np.float32(min(max(0.0, largest + more), LAST_BINADE)))) for more in (-farthest, farthest)
    )
    # The inverse of pdecodec.codec.sections.residuals.residual_step.
    of_step = math.sqrt(3.0) / 2.0 * (animation.residual_step / SAFETY + near)
    settings, is_alone = _recorded(animation), animation.residual_step > far / 4.0
    if settings is None:
        return of_step if is_alone else SMALLEST_BOUND
    diagonal = math.hypot(*np.ptp(points, axis=0).tolist())
    said = settings.bound(max(0.0, diagonal - 2.0 * math.sqrt(3.0) * farthest))
    if said is None:
        return None
    # A tolerance is relative to a diagonal that is known only approximately here.
    return of_step if is_alone and settings.max_error is None else min(said, of_step)


def _recorded(animation: Animation) -> EncodeSettings | None:
    """Return the settings that a file's remarks state; None if they state none."""
    information = animation.info()
    if not information["generator"].startswith(GENERATOR):
        return None  # Remarks leave out defaults, so remarks of other programs would seem to mean "all defaults".
    try:
        return EncodeSettings.from_json(information["settings"])
    except (SettingsError, TypeError):
        return None


def alternatives_of(animation: Animation) -> list[Question]:
    """Return the alternatives that an encoder compares in the first frames, by encoding the decoded frames again.

    Raises
    ------
    InputError
        If the file has several runs of frames.
    """
    if len(animation.runs) > 1:
        raise InputError(
            "has several runs of frames, each of which was encoded separately",
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
