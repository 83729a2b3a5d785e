"""What a file tells of how it was encoded: its bound, and what else could have been taken."""

from __future__ import annotations

import math

import numpy as np

from pdecodec.codec.decoder import Animation
from pdecodec.codec.encode.alternatives import GroupAlternatives
from pdecodec.codec.encode.fit import GroupChoice
from pdecodec.codec.encode.quantise import grid_index
from pdecodec.codec.encode.report import GENERATOR, Question
from pdecodec.codec.encoding_memory import memory_plan
from pdecodec.codec.run_encoder import COMPARED_FRAMES, compare_profiles
from pdecodec.codec.sections.residuals import LAST_BINADE, SAFETY
from pdecodec.codec.settings import SMALLEST_BOUND, EncodeSettings
from pdecodec.errors import InputError, SettingsError


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
    """Other ways to encode the first groups of a file, found out from what it decodes to: so about.

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
    groups: list[tuple[int, GroupChoice]] = []
    frames = 0
    for entry in animation.groups:
        if entry.basis == "closed form" or (groups and frames + entry.frames > COMPARED_FRAMES):
            break
        groups.append((entry.frames, GroupChoice(entry.basis, "reference", grid_index(entry.step))))
        frames += entry.frames
    if not groups or bound is None:
        return [compare_profiles(animation, bound, "paper")]
    reference, basis = animation.reference_and_space()
    points = animation.read_frames(0, frames)
    group = GroupAlternatives(
        points,
        groups,
        animation.times,
        animation.meshes,
        reference=reference,
        basis=basis,
        functions=memory_plan(animation.vertex_count, animation.frame_count, EncodeSettings()).functions,
        bound=bound,
        unit=max(bound, float(np.spacing(np.abs(points[0]).max()))),
        residual_step=animation.residual_step,
    )
    return [*group.questions(), compare_profiles(animation, bound, "auto")]
