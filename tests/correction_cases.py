"""Corrections of groups that several tests share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from pdecodec.group_corrections import GroupCorrections, no_corrections
from pdecodec.limits import LARGEST

Int64Array = NDArray[np.int64]

FINITE = st.floats(width=32, allow_nan=False, allow_infinity=False)


def of_frames(
    frames: list[tuple[list[int], list[list[int]]]], literals: dict[int, dict[int, list[float]]]
) -> GroupCorrections:
    """From places and levels of each frame, and literals by frame and place."""
    counts = [len(places) for places, _ in frames]
    literal_counts = [len(literals.get(frame, {})) for frame in range(len(frames))]
    literal_places = [place for frame in range(len(frames)) for place in sorted(literals.get(frame, {}))]
    positions = [literals[frame][place] for frame in sorted(literals) for place in sorted(literals[frame])]
    return GroupCorrections(
        np.cumsum([0, *counts]),
        np.array([place for places, _ in frames for place in places], np.int64),
        np.array([level for _, levels in frames for level in levels], np.int64).reshape(-1, 3),
        np.cumsum([0, *literal_counts]),
        np.array(literal_places, np.int64),
        np.array(positions, np.float32).reshape(-1, 3),
    )


def of_field(levels: Int64Array) -> GroupCorrections:
    """(frames, places, 3) levels: corrections wherever they are not all zero."""
    frames, places = np.nonzero(levels.any(axis=2))
    starts = np.searchsorted(frames, np.arange(len(levels) + 1)).astype(np.int64)
    return replace(
        no_corrections(len(levels)), frame_starts=starts, places=places.astype(np.int64), levels=levels[frames, places]
    )


def starts_of(places: int, patch: int) -> Int64Array:
    return np.append(np.arange(0, places, patch), places).astype(np.int64)


@st.composite
def groups(draw: st.DrawFn) -> tuple[GroupCorrections, Int64Array]:
    frames, sizes = draw(st.integers(1, 6)), draw(st.lists(st.integers(1, 9), min_size=1, max_size=6))
    starts = np.cumsum([0, *sizes])
    density = draw(st.sampled_from([0.05, 0.5, 1.0]))
    largest = draw(st.sampled_from([1, 3, 40, 2**20, LARGEST]))
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    levels = random.integers(-largest, largest, (frames, int(starts[-1]), 3), endpoint=True)
    if draw(st.booleans()):
        levels[1:] = levels[:1]
    group = of_field(np.where(random.random((*levels.shape[:2], 1)) < density, levels, 0))
    literal = random.random(levels.shape[:2]) < draw(st.sampled_from([0.0, 0.1]))
    at, places = np.nonzero(literal)
    positions = draw(arrays.arrays(np.float32, (places.size, 3), elements=FINITE))
    literal_starts = np.searchsorted(at, np.arange(frames + 1)).astype(np.int64)
    group = replace(
        group, literal_frame_starts=literal_starts, literal_places=places.astype(np.int64), literals=positions
    )
    return group, starts


def walk(seed: int, frames: int, places: int, spread: float, drift: float) -> Int64Array:
    """Levels that go on as they went in time and are alike in neighbouring places."""
    random = np.random.default_rng(seed)
    along = np.cumsum(random.normal(size=(places, 4, 3)), axis=0) / np.sqrt(places)
    time = np.sin(np.arange(frames)[:, None] * drift * np.array([1.0, 1.7, 2.3, 3.1]))
    field = spread * np.einsum("fk,pkx->fpx", time, along)
    levels: Int64Array = np.rint(field + random.normal(size=field.shape) * 0.3).astype(np.int64)
    return levels


def example() -> tuple[GroupCorrections, Int64Array]:
    levels = walk(4, 6, 60, 3.0, 0.4)
    levels[:, 20:40] = 0
    group = of_field(levels)
    return replace(
        group,
        literal_frame_starts=np.array([0, 0, 2, 2, 2, 3, 3]),
        literal_places=np.array([21, 30, 39]),
        literals=np.arange(9, dtype=np.float32).reshape(3, 3),
    ), starts_of(60, 15)
