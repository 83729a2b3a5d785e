"""The vectors of format version 2 that every decoder must read.

What the encoder would choose by size is given here, so that small clips have what their names say.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Any
from unittest.mock import patch

import numpy as np

from pdecodec import ArraySequence, EncodeSettings, MeshObject, encode, groupchoice, groupencoder
from pdecodec.curves import extract_curves
from pdecodec.group_corrections import GroupCorrections, encode_group
from pdecodec.groupchoice import FIRST_CHOICE
from pdecodec.groups import TimeBasis
from pdecodec.restcoding import decode_rest
from pdecodec.restshape import encode_rest_along_curves
from pdecodec.sequence import MeshSequence
from pdecodec.spacebasis import SpaceKind
from spec.accepted import (
    LINES,
    clip,
    connectivity,
    grid,
    noise,
    several_objects,
    triangles,
    tube,
    turning,
    wave,
    with_attributes,
)
from spec.sealing import Part, content, seal, take_apart, with_first_group, with_group_section


@dataclass(frozen=True, kw_only=True)
class Choices:
    """What the encoder is held to: its settings, and what it would otherwise choose by size."""

    time: TimeBasis = "modal"
    space: tuple[SpaceKind, int] = ("patch", 64)
    longest_group: int = 512
    settings: dict[str, Any] = field(default_factory=dict)


def encoded(sequence: MeshSequence, choices: Choices) -> bytes:
    """A file of version 2."""
    with ExitStack() as held:
        held.enter_context(patch.object(groupencoder, "FIRST_CHOICE", replace(FIRST_CHOICE, time=choices.time)))
        held.enter_context(patch.object(groupencoder, "LONGEST_GROUP", choices.longest_group))
        held.enter_context(patch.object(groupencoder, "SPACES", (choices.space,)))
        held.enter_context(patch.object(groupchoice, "SPACES", (choices.space,)))
        # The lowest effort looks at no other time basis.
        settings = EncodeSettings(profile="auto", **{"effort": 1, **choices.settings})
        data = encode(sequence, settings=settings).data
    assert data is not None  # no path was given
    return data


def soup() -> ArraySequence:
    """Quads that share points, each with vertices of its own."""
    corners = grid(4, 5).face_indices
    faces = np.arange(corners.size).reshape(-1, 4).tolist()
    return clip(wave(6, 4, 5)[:, corners], connectivity(corners.size, faces))


def two_sheets() -> ArraySequence:
    """Sheets apart from each other, one of them still, and a vertex of no face."""
    moving = wave(7, 4, 9)
    still = np.repeat(wave(1, 3, 5), 7, axis=0) + np.array([12.0, 0.0, 1.0])
    sheets = [MeshObject("moving", grid(4, 9)), MeshObject("still", grid(3, 5)), MeshObject("", connectivity(1))]
    return ArraySequence(np.concatenate([moving, still, np.ones((7, 1, 3))], axis=1), objects=sheets)


def rough(frames: int, rows: int, columns: int) -> ArraySequence:
    """A sheet that waves, and trembles: most of that is left to corrections."""
    return clip(wave(frames, rows, columns) + 0.03 * noise(frames, rows * columns, 3), grid(rows, columns))


def in_cosines(frames: int) -> ArraySequence:
    """A sheet that swings in two of the cosines of a clip of so many frames: other frames need no number."""
    phase = np.pi * (np.arange(frames)[:, None] + 0.5) / frames
    swing = np.cos(3 * phase) * wave(1, 4, 6)[0, :, 2] + np.cos(7 * phase) * np.arange(24) / 24
    points = np.repeat(wave(1, 4, 6), frames, axis=0)
    points[:, :, 2] = swing
    return clip(points, grid(4, 6))


def sheet(frames: int = 8, **options: Any) -> ArraySequence:
    return clip(wave(frames, 4, 6), grid(4, 6), **options)


IRREGULAR = [-2, -1.5, -1, 0, 0.1, 0.11, 5, 5.5, 7.25]

SEQUENCES: dict[str, tuple[Callable[[], MeshSequence], Choices]] = {
    "modes_followed": (lambda: sheet(12), Choices()),
    "modes_transformed": (lambda: in_cosines(40), Choices(settings={"tolerance": 1e-4})),
    "cosines": (lambda: sheet(12), Choices(time="pde")),
    "shapes_followed": (lambda: sheet(12), Choices(time="shapes")),
    "shapes_transformed": (lambda: in_cosines(40), Choices(time="shapes", settings={"tolerance": 1e-4})),
    "shapes_in_double": (lambda: sheet(6), Choices(time="shapes", settings={"tolerance": 1e-6})),
    "groups_of_shapes": (lambda: sheet(11), Choices(time="shapes", longest_group=4)),
    "groups": (lambda: sheet(11), Choices(longest_group=4)),
    "groups_of_cosines": (lambda: sheet(11), Choices(time="pde", longest_group=4)),
    "groups_of_one_frame": (lambda: sheet(3), Choices(longest_group=1)),
    "groups_in_double": (lambda: sheet(6), Choices(longest_group=3, settings={"tolerance": 1e-6})),
    "cosines_in_double": (lambda: sheet(6), Choices(time="pde", settings={"tolerance": 1e-6})),
    "many_patches": (two_sheets, Choices(space=("patch", 8))),
    "many_pieces": (lambda: clip(tube(8, 5, 20), grid(5, 20, closed=True)), Choices(space=("curve", 8))),
    "triangles": (lambda: clip(wave(8, 5, 6), triangles(5, 6)), Choices(space=("patch", 16))),
    "polygons_attributes": (with_attributes, Choices()),
    "several_objects": (several_objects, Choices(space=("patch", 16))),
    "lines": (lambda: clip(wave(8, 3, 7), connectivity(21, lines=LINES)), Choices(space=("patch", 8))),
    "points": (lambda: clip(noise(1, 40, 3) + 0.1 * noise(7, 40, 3, seed=1)), Choices()),
    "one_vertex": (lambda: clip(noise(9, 1, 3)), Choices()),
    "welded": (soup, Choices()),
    "one_frame": (lambda: sheet(1, times=[1.5]), Choices()),
    "two_frames": (lambda: sheet(2), Choices()),
    "static": (lambda: clip(np.repeat(wave(1, 5, 7), 5, axis=0), grid(5, 7)), Choices()),
    "rigid": (lambda: clip(turning(12, tube(1, 5, 8)[0]), grid(5, 8, closed=True)), Choices()),
    "corrections": (lambda: rough(6, 3, 6), Choices(settings={"tolerance": 3e-3})),
    "explosion": (lambda: clip(wave(6, 3, 5) + 1e20 * np.eye(6, 1, -3)[:, :, None], grid(3, 5)), Choices()),
    "irregular_times": (lambda: sheet(9, times=IRREGULAR), Choices()),
    "times_at_another_rate": (lambda: sheet(9, times=np.arange(9) / 25, fps=24), Choices()),
    "times_by_period": (lambda: sheet(9, times=np.arange(9) * (1 / 24), fps=24), Choices()),
    "long_clip": (lambda: clip(wave(120, 2, 2), grid(2, 2)), Choices(longest_group=40)),
}


def corrected(levels: np.ndarray[Any, np.dtype[np.int64]]) -> GroupCorrections:
    """Corrections by levels, (frames, vertices, 3); rows of zeros are none. No literals."""
    frames, places = np.nonzero(levels.any(axis=2))
    starts = np.searchsorted(frames, np.arange(len(levels) + 1)).astype(np.int64)
    none = np.zeros(0, np.int64)
    literals = np.zeros((0, 3), np.float32)
    return GroupCorrections(starts, places, levels[frames, places], np.zeros_like(starts), none, literals)


def corrections_by_hand() -> Iterator[tuple[str, GroupCorrections]]:
    """Of eight frames of 24 vertices in one patch."""
    random = np.random.default_rng(0)
    turn = random.integers(-40, 40, (3, 24, 3)) * (random.random((3, 24, 1)) < 0.4)
    yield "corrections_in_a_cycle", corrected(turn[np.arange(8) % 3])
    drift = np.cumsum(np.cumsum(random.integers(-3, 4, (8, 24, 3)), axis=0), axis=0) * 20
    yield "corrections_predicted", corrected(drift)
    huge = np.zeros((8, 24, 3), np.int64)
    huge[1, 5], huge[2, 5], huge[2, 23] = (2**40, -(2**40), 1), (-(2**40), 2**40, -1), (0, 0, 7)
    yield "corrections_from_end_to_end", corrected(huge)


def accepted() -> Iterator[tuple[str, bytes]]:
    """Files that every decoder must read."""
    for name, (make, choices) in SEQUENCES.items():
        yield name, encoded(make(), choices)
    still = take_apart(encoded(clip(np.repeat(wave(1, 4, 6), 8, axis=0), grid(4, 6)), Choices()))
    for name, corrections in corrections_by_hand():
        chunk = encode_group(corrections, np.array([0, 24]))
        yield name, seal(with_first_group(still, "CORR", chunk), major=2)
    parts = take_apart(encoded(sheet(), Choices(longest_group=4)))
    unknown = [Part("XYZW", b"anything", 0), *parts, Part("\xff\x00ab", b"", 0x0E)]
    flagged = [replace(part, flags=part.flags | 0x08) for part in unknown]
    yield "unknown_ignorable_sections", seal(flagged, major=2, minor=7)
    yield "sections_in_another_order", seal(parts[::-1], major=2)
    yield "without_remarks", seal([part for part in parts if part.kind != "META"], major=2)
    rest = content(parts, "REST")
    sheets = sheet().objects
    along = encode_rest_along_curves(decode_rest(rest, sheets), extract_curves(sheets))
    yield "rest_along_curves", seal(with_group_section(parts, "REST", along), major=2)
    # Modes without bytes are all zero: whatever the coefficients are, nothing moves.
    yield "modes_of_length_zero", seal(with_first_group(parts, "TIME", b""), major=2)
