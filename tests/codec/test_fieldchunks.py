"""Chunks of fields: what is encoded comes back, within the step, on any domain, and damage is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pdecodec import CorruptFileError, _core

SITES = {"vertex": 0, "face": 1, "corner": 2, "object": 3}
NONE = np.zeros(0, np.int32)


def grid(columns: int, rows: int) -> tuple[int, ...]:
    """Return a part: a grid of quads, one edge along its first row, and a vertex of its own."""
    first = np.arange(columns * rows, dtype=np.int32).reshape(rows, columns)
    quads = np.stack([first[:-1, :-1], first[:-1, 1:], first[1:, 1:], first[1:, :-1]], axis=-1).reshape(-1, 4)
    sizes = np.full(len(quads), 4, np.int32)
    line = first[0, :2].copy()
    return (columns * rows + 1, sizes, quads.ravel(), np.array([line.size], np.int32), line)  # type: ignore[return-value]


def domain(site: str) -> _core.FieldDomain:
    return _core.FieldDomain(SITES[site], [grid(4, 3), grid(2, 2)])  # type: ignore[list-item]


def decoded(
    at: _core.FieldDomain, values: np.ndarray, kinds: np.ndarray | None, levels: int, step: int
) -> _core.FieldChunk:
    data = _core.encode_field_chunk(at, values, kinds, levels, step)
    return _core.decode_field_chunk(at, data, values.shape[0], values.shape[2])


@pytest.mark.parametrize(("site", "rows"), [("vertex", 18), ("face", 7), ("corner", 28), ("object", 2)])
def test_a_domain_has_the_rows_of_all_objects(site: str, rows: int) -> None:
    assert domain(site).rows == rows


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_values_come_back_within_half_the_step_and_with_their_kinds(data: st.DataObject) -> None:
    at = domain(data.draw(st.sampled_from(sorted(SITES))))
    shape = (data.draw(st.integers(1, 9)), at.rows, data.draw(st.integers(1, 4)))
    largest = data.draw(st.sampled_from([1, 20, 2**16, 2**36]))
    values = data.draw(arrays.arrays(np.int64, shape, elements=st.integers(-largest, largest)))
    kinds = data.draw(st.none() | arrays.arrays(np.uint8, shape, elements=st.integers(0, 3)))
    step = data.draw(st.sampled_from([1, 15, 255]))
    found = decoded(at, values, kinds, data.draw(st.integers(0, 8)), step)
    numbers = np.ones(shape, bool) if kinds is None else kinds == 0
    assert np.abs(found.values - values)[numbers].max(initial=0) <= step // 2
    assert (found.kinds is None) == (kinds is None)
    if kinds is not None:
        assert np.array_equal(found.kinds, kinds)


@pytest.mark.parametrize("site", SITES)
def test_frames_that_repeat_cost_next_to_nothing(site: str) -> None:
    at = domain(site)
    frame = np.random.default_rng(0).integers(-1000, 1000, (1, at.rows, 2))
    still = [len(_core.encode_field_chunk(at, np.repeat(frame, n, axis=0), None, 0, 1)) for n in (1, 200)]
    assert still[1] - still[0] <= 12


def test_a_smooth_field_costs_less_with_frames_between_frames() -> None:
    at = domain("vertex")
    times = np.arange(65)[:, None, None] / 10
    values = np.rint(1e4 * np.sin(times + np.arange(at.rows)[:, None] / 5)).astype(np.int64)
    sizes = {levels: len(_core.encode_field_chunk(at, values, None, levels, 15)) for levels in (0, 4)}
    assert sizes[4] < sizes[0]


def test_damaged_chunks_are_refused() -> None:
    at = domain("vertex")
    values = np.random.default_rng(1).integers(-50, 50, (3, at.rows, 1))
    data = _core.encode_field_chunk(at, values, None, 1, 3)
    for damaged in (
        b"",
        data[:1],
        b"\x20" + data[1:],
        b"\x09" + data[1:],
        data[:1] + b"\x02" + data[2:],
        data[:-4],
        data + b"\1",
    ):
        with pytest.raises(CorruptFileError):
            _core.decode_field_chunk(at, damaged, *values.shape[::2])
    assert np.abs(_core.decode_field_chunk(at, data, 3, 1).values - values).max() <= 1
