"""Design variables as the paper counts them, and the bytes that a decoder needs."""

from __future__ import annotations

from dataclasses import dataclass

from pdecodec.decoder import open_animation
from pdecodec.encoder import encode
from pdecodec.experiments.reproduction.bspline import CONTROL_POINTS
from pdecodec.experiments.reproduction.rope import FRAMES, Rope
from pdecodec.metrics import measure_distortion
from pdecodec.settings import EncodeSettings

NUMBER_BYTES = 4
"""Everything is counted as float32, as the positions are."""

KEYFRAME_COUNT = 6

TRANSFORMATION_NUMBERS = 12
"""A 3 x 3 matrix and a translation, Eqs. 19 to 23."""

CONSTANTS = 32


@dataclass(frozen=True)
class Store:
    """What one representation of the clip takes.

    Attributes
    ----------
    name : str
    variables : int or None
        Design variables as the paper counts them; None where it does not count.
    parts : dict of str to int
        Bytes, by what they are for.
    largest_error : float or None
        Largest vertex distance over D at frames 0 to 10, where it was measured.
    """

    name: str
    variables: int | None
    parts: dict[str, int]
    largest_error: float | None = None

    @property
    def total(self) -> int:
        return sum(self.parts.values())


def stores(rope: Rope, *, printed_error: float, honest_error: float, spline_error: float) -> list[Store]:
    """Every representation, connectivity left out of all of them.

    Parameters
    ----------
    rope : Rope
    printed_error, honest_error, spline_error : float
        Largest errors over D of the PDE method as printed, of the same with what a decoder knows, of fair B-splines.
    """
    sides, rings = rope.settings.sides, rope.settings.rings
    vector = 3 * NUMBER_BYTES
    raw = sides * rings * vector
    constants = sides * CONSTANTS * vector
    transformations = sides * FRAMES * TRANSFORMATION_NUMBERS * NUMBER_BYTES
    control = sides * CONTROL_POINTS * KEYFRAME_COUNT
    return [
        Store("raw positions", sides * rings * FRAMES, {"positions": FRAMES * raw}, 0.0),
        Store(
            "PDE as printed",
            sides * CONSTANTS,
            {"constants": constants, "transformations": transformations, "u of Eq. 24": FRAMES * raw},
            printed_error,
        ),
        Store("PDE, u a decoder knows", None, {"constants": constants, "rest shape": raw}, honest_error),
        Store("B-splines, fair", control, {"control points": control * vector, "rest shape": raw}, spline_error),
        _file(rope, "pdecodec --profile paper", EncodeSettings(profile="paper")),
        _file(rope, "pdecodec, PDE's error as printed", EncodeSettings(max_error=printed_error * rope.diameter)),
        _file(rope, "pdecodec, PDE's error honest", EncodeSettings(max_error=honest_error * rope.diameter)),
    ]


def _file(rope: Rope, name: str, settings: EncodeSettings) -> Store:
    report = encode(rope.clip, settings=settings)
    assert report.data is not None  # no path was given
    with open_animation(report.data) as animation:
        largest = measure_distortion(rope.clip, animation.to_array()).max_error / rope.diameter
    sizes = dict(report.sections)
    parts = {"rest shape": sizes.pop("REST"), "motion": sum(size for key, size in sizes.items() if key not in _MESH)}
    return Store(name, None, parts, largest)


_MESH = frozenset({"CONN", "ORDR", "ATTR"})
"""Sections that hold faces and what belongs to them, which are counted nowhere here."""
