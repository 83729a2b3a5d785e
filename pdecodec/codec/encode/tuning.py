"""What each level of effort searches: time against bytes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from pdecodec.codec.encode.quantise import DEAD_ZONE, DeadZone
from pdecodec.codec.sections.space_basis import SpaceKind
from pdecodec.codec.settings import EffortName

SpaceBases = tuple[tuple[SpaceKind, int], ...]


@dataclass(frozen=True, kw_only=True)
class Effort:
    """What an encode under profile "auto" looks at.

    Attributes
    ----------
    space_bases : tuple of (kind, points)
        Kinds and sizes of patches; the first is taken where nothing moves.
    more_of_small : tuple of (kind, points)
        For small meshes (`pdecodec.codec.encode.fit.SMALL_MESH`).
    larger_must_save : float
        Share of the coefficients' bits that larger patches than the first must save on large meshes: making their
        functions takes every reader the square of their number.
    references_of_small : bool
        Whether the step of the reference frame is searched on small meshes, too, where each takes a fit.
    fine_steps : bool
        Whether steps are searched closely, and functions of time have steps of their own.
    division : bool
        Whether shorter groups are tried.
    rounding_passes : int
        How often coefficients are rounded again towards what vertices beyond the bound miss.
    least_gain : float
        Share of the bits that rounding again must save for it to be done once more; 0 where it goes on nevertheless.
    last_steps : tuple of int
        Steps of coefficients, as indices from the chosen one, with which whole groups are fitted to compare them.
    first_passes : int
        How often coefficients are rounded again in these fits.
    second_passes : int
        How often in those of the one that costs least and of the next coarser one, before one of them is taken.
    dead_zones : tuple of DeadZone
        In fits whose coefficients are rounded again; the first is the usual one.
    also : str or None
        An effort whose model, as it is or refined, is taken where it costs less.
    tighter_bounds : tuple of float
        How many times tighter bounds are whose models are tried too, on clips of at most `SMALL_CLIP` positions.
    searched_clip : float
        Positions up to which anything is tried at all. Of larger clips the last kind and size of patches is taken, and
        steps that leave the usual mean error.
    """

    space_bases: SpaceBases
    more_of_small: SpaceBases = ()
    larger_must_save: float = 0.0
    references_of_small: bool = True
    fine_steps: bool = True
    division: bool = True
    rounding_passes: int = 0
    least_gain: float = 0.0
    last_steps: tuple[int, ...] = (0,)
    first_passes: int = 0
    second_passes: int = 0
    dead_zones: tuple[DeadZone, ...] = (DEAD_ZONE,)
    also: EffortName | None = None
    tighter_bounds: tuple[float, ...] = ()
    searched_clip: float = math.inf

    def refined_like(self, other: Effort) -> Effort:
        """The same search, its coefficients rounded again as another effort does it."""
        return replace(
            self,
            rounding_passes=other.rounding_passes,
            least_gain=other.least_gain,
            last_steps=other.last_steps,
            first_passes=other.first_passes,
            second_passes=other.second_passes,
            dead_zones=other.dead_zones,
        )


SMALL_CLIP = 2**16
"""Positions, frames times vertices, up to which a clip is small."""

EFFORTS: dict[EffortName, Effort] = {
    "fast": Effort(
        space_bases=(("patch", 64), ("patch", 128)),
        more_of_small=(("patch", 256), ("patch", 8)),
        larger_must_save=0.02,
        references_of_small=False,
        fine_steps=False,
        division=False,
        searched_clip=2**19,
    ),
    "default": Effort(
        space_bases=(("patch", 64), ("patch", 32), ("patch", 128)),
        more_of_small=(("patch", 256), ("patch", 8)),
        larger_must_save=0.02,
        rounding_passes=3,
        least_gain=0.004,
        tighter_bounds=(1.1, 1.21),
    ),
    "best": Effort(
        space_bases=(("patch", 64), ("patch", 32), ("patch", 128), ("patch", 16), ("curve", 64), ("curve", 128)),
        more_of_small=(("patch", 256), ("patch", 8)),
        rounding_passes=32,
        last_steps=(-1, 0, 1),
        first_passes=4,
        second_passes=24,
        dead_zones=((0.7, 1.0), (0.65, 0.85)),
        also="default",
        tighter_bounds=(1.1, 1.21),
    ),
}
"""By the name that settings have."""
