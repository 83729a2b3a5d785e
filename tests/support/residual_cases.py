"""Residuals of groups for several tests."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pdecodec.codec.sections.bytestream import LARGEST
from pdecodec.codec.sections.residuals import Residuals
from pdecodec.mesh.arrays import Int64Array

FINITE = st.floats(width=32, allow_nan=False, allow_infinity=False)

Raw = dict[int, dict[int, list[float]]]


def of_frames(frames: list[tuple[list[int], list[list[int]]]], raw: Raw) -> Residuals:
    """Return residuals from the corrected places and the steps of each frame, and raw vertices by frame and place."""
    raw_places = [place for frame in range(len(frames)) for place in sorted(raw.get(frame, {}))]
    positions = [raw[frame][place] for frame in sorted(raw) for place in sorted(raw[frame])]
    return Residuals(
        np.cumsum([0, *(len(places) for places, _ in frames)]),
        np.array([place for places, _ in frames for place in places], np.int32),
        np.array([steps for _, quantised in frames for steps in quantised], np.int64).reshape(-1, 3),
        np.cumsum([0, *(len(raw.get(frame, {})) for frame in range(len(frames)))]),
        np.array(raw_places, np.int32),
        np.array(positions, np.float32).reshape(-1, 3),
    )


def none_of(frames: int) -> Residuals:
    """Return the residuals of a group whose frames all keep the bound: no corrections."""
    return of_frames([([], [])] * frames, {})


def of_field(quantised: Int64Array, raw: Raw | None = None) -> Residuals:
    """Return residuals from (frames, places, 3) steps: a correction wherever the three are not all zero."""
    some = [np.flatnonzero(steps.any(axis=1)) for steps in quantised]
    frames = [(places.tolist(), steps[places].tolist()) for places, steps in zip(some, quantised, strict=True)]
    return of_frames(frames, raw or {})


def starts_of(places: int, patch: int) -> Int64Array:
    return np.append(np.arange(0, places, patch), places).astype(np.int64)


@st.composite
def groups(draw: st.DrawFn) -> tuple[Residuals, Int64Array]:
    frames, sizes = draw(st.integers(1, 6)), draw(st.lists(st.integers(1, 9), min_size=1, max_size=6))
    starts = np.cumsum([0, *sizes])
    density = draw(st.sampled_from([0.05, 0.5, 1.0]))
    largest = draw(st.sampled_from([1, 3, 40, 2**20, LARGEST]))
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    quantised = random.integers(-largest, largest, (frames, int(starts[-1]), 3), endpoint=True)
    if draw(st.booleans()):
        quantised[1:] = quantised[:1]
    is_raw = random.random(quantised.shape[:2]) < draw(st.sampled_from([0.0, 0.1]))
    raw: Raw = {frame: {} for frame in range(frames)}
    positions = draw(arrays.arrays(np.float32, (int(is_raw.sum()), 3), elements=FINITE))
    for frame, place, position in zip(*np.nonzero(is_raw), positions.tolist(), strict=True):
        raw[int(frame)][int(place)] = position
    return of_field(np.where(random.random((*is_raw.shape, 1)) < density, quantised, 0), raw), starts


def walk(seed: int, frames: int, places: int, spread: float, drift: float) -> Int64Array:
    """Return steps that continue over time and resemble those of neighbouring places."""
    random = np.random.default_rng(seed)
    along = np.cumsum(random.normal(size=(places, 4, 3)), axis=0) / np.sqrt(places)
    time = np.sin(np.arange(frames)[:, None] * drift * np.array([1.0, 1.7, 2.3, 3.1]))
    field = spread * np.einsum("fk,pkx->fpx", time, along)
    quantised: Int64Array = np.rint(field + random.normal(size=field.shape) * 0.3).astype(np.int64)
    return quantised


def example() -> tuple[Residuals, Int64Array]:
    quantised = walk(4, 6, 60, 3.0, 0.4)
    quantised[:, 20:40] = 0
    raw: Raw = {1: {21: [0.0, 1.0, 2.0], 30: [3.0, 4.0, 5.0]}, 4: {39: [6.0, 7.0, 8.0]}}
    return of_field(quantised, raw), starts_of(60, 15)
