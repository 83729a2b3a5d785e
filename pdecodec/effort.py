"""What each level of effort searches: time against bytes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pdecodec.settings import EffortName
from pdecodec.spacebasis import SpaceKind

SpaceBases = tuple[tuple[SpaceKind, int], ...]


@dataclass(frozen=True, kw_only=True)
class Effort:
    """What an encode under profile "auto" looks at.

    Attributes
    ----------
    space_bases : tuple of (kind, points)
        Kinds and sizes of patches; the first is taken where nothing moves.
    more_of_small : tuple of (kind, points)
        For small meshes (`pdecodec.groupfit.SMALL_MESH`).
    larger_must_save : float
        Share of the coefficients' bits that larger patches than the first must save on large meshes: making their
        functions takes every reader the square of their number.
    time_bases : bool
        Whether other functions of time than trajectories, and displacements from the first frame, are tried.
    reference_steps : bool
        Whether the step of the reference frame is searched.
    fine_steps : bool
        Whether steps are searched closely, and functions of time have steps of their own.
    division : bool
        Whether shorter groups are tried.
    rounding_passes : int
        How often coefficients are rounded again towards what vertices beyond the bound miss.
    last_steps : tuple of int
        Steps of coefficients, as indices from the chosen one, with which whole groups are fitted to compare them: a
        coarser one gains more when coefficients are rounded again.
    first_passes : int
        How often coefficients are rounded again in these fits.
    tighter_bounds : tuple of float
        How many times tighter bounds are whose models are tried too, on clips of at most `SMALL_CLIP` positions.
    searches_all_clips : bool
        Whether they are tried on larger clips as well.
    searched_clip : float
        Positions up to which anything is tried at all. Of larger clips the last kind and size of patches is taken, and
        steps that leave the usual mean error.
    """

    space_bases: SpaceBases
    more_of_small: SpaceBases = ()
    larger_must_save: float = 0.0
    time_bases: bool = True
    reference_steps: bool = True
    fine_steps: bool = True
    division: bool = True
    rounding_passes: int = 0
    last_steps: tuple[int, ...] = (0,)
    first_passes: int = 0
    tighter_bounds: tuple[float, ...] = ()
    searches_all_clips: bool = False
    searched_clip: float = math.inf


SMALL_CLIP = 2**16
"""Positions, frames times vertices, up to which a clip is small."""

EFFORTS: dict[EffortName, Effort] = {
    "fast": Effort(
        space_bases=(("patch", 64), ("patch", 128)),
        larger_must_save=0.02,
        time_bases=False,
        reference_steps=False,
        fine_steps=False,
        division=False,
        searched_clip=2**19,
    ),
    "default": Effort(
        space_bases=(("patch", 64), ("patch", 32), ("patch", 128)),
        more_of_small=(("patch", 256), ("patch", 8)),
        larger_must_save=0.02,
        rounding_passes=3,
        tighter_bounds=(1.1, 1.21),
    ),
    "best": Effort(
        space_bases=(("patch", 64), ("patch", 32), ("patch", 128), ("patch", 16), ("curve", 64), ("curve", 128)),
        more_of_small=(("patch", 256), ("patch", 8)),
        rounding_passes=24,
        last_steps=(-1, 0, 1, 2),
        first_passes=4,
        tighter_bounds=(1.1, 1.21),
        searches_all_clips=True,
    ),
}
"""By the name that settings have."""
