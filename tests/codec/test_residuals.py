"""Residuals of a group of frames: the plain decoder of the specification reads them; and what they cost."""

from __future__ import annotations

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings

from pdecodec.codec.sections.residuals import Residuals, encode_residuals, plan_residuals
from pdecodec.mesh.arrays import Int64Array
from spec.decoder.fields import CorruptFileError
from spec.decoder.residuals import read_residuals
from tests.support.residual_cases import example, groups, none_of, of_field, of_frames, starts_of, walk


def assert_comes_back(group: Residuals, starts: Int64Array) -> bytes:
    """Encode residuals; check that the bytes are reproducible, as many as measured, and read correctly by both
    decoders.
    """
    data = encode_residuals(group, starts)
    assert encode_residuals(group, starts) == data
    assert -8 <= 8 * len(data) - plan_residuals(group, starts).bits < 64 + 0.005 * 8 * len(data)
    for frame, plain in enumerate(read_residuals(data, group.frames, starts.tolist())):
        some = slice(group.frame_starts[frame], group.frame_starts[frame + 1])
        raw = slice(group.raw_frame_starts[frame], group.raw_frame_starts[frame + 1])
        assert list(plain.levels) == group.places[some].tolist()
        assert [list(steps) for steps in plain.levels.values()] == group.quantised[some].tolist()
        assert list(plain.raw) == group.raw_places[raw].tolist()
        assert [list(position) for position in plain.raw.values()] == group.raw_positions[raw].tolist()
    return data


@settings(max_examples=40)
@given(groups())
def test_residuals_come_back_to_the_last_bit(case: tuple[Residuals, Int64Array]) -> None:
    assert_comes_back(*case)


@pytest.mark.parametrize("spread", [0.6, 3.0, 1e3, 1e11])
def test_residuals_of_every_vertex_come_back_and_take_less_than_differences_do(spread: float) -> None:
    quantised = walk(1, 16, 160, spread, 0.2)
    data = assert_comes_back(of_field(quantised), starts_of(160, 32))
    narrow = np.diff(quantised, axis=0, prepend=0).astype(np.int64 if spread > 1e9 else np.int32)
    planes = np.frombuffer(narrow.tobytes(), np.uint8).reshape(-1, narrow.itemsize).T.tobytes()
    assert len(data) < 0.95 * len(zstandard.compress(planes, 19))


def test_a_cycle_costs_its_first_turn() -> None:
    random = np.random.default_rng(2)
    turn = np.rint(random.normal(size=(8, 60, 3)) * 30).astype(np.int64)
    starts = starts_of(60, 20)
    once, thrice = (assert_comes_back(of_field(np.tile(turn, (turns, 1, 1))), starts) for turns in (1, 3))
    assert len(thrice) < 1.25 * len(once)


def test_few_residuals_gathered_in_place_and_time_cost_less_than_scattered_ones() -> None:
    random = np.random.default_rng(3)
    starts = starts_of(2000, 40)
    gathered, scattered = np.zeros((2, 40, 2000, 3), np.int64)
    gathered[10:30, 500:520] = random.integers(0, 2, (20, 1, 3)) + np.array([1, 0, 0])
    at = random.permutation(40 * 2000)[:400]
    scattered.reshape(-1, 3)[at] = gathered[10:30, 500:520].reshape(-1, 3)
    costs = [plan_residuals(of_field(field), starts).bits / 400 for field in (gathered, scattered)]
    assert costs[0] < 4
    assert costs[1] > 2.5 * costs[0]


def test_no_residuals_are_no_bytes() -> None:
    assert assert_comes_back(none_of(7), starts_of(50, 16)) == b""
    assert plan_residuals(none_of(7), starts_of(50, 16)).bits == 0.0


def test_raw_vertices_alone_come_back() -> None:
    group = of_frames([([], [])] * 4, {1: {3: [1.5, -2.0, 3e38], 4: [0.0, -0.0, 1e-45]}, 3: {0: [7.0, 8.0, 9.0]}})
    data = assert_comes_back(group, starts_of(5, 2))
    assert len(data) < 12 * 3 + 12


@pytest.mark.parametrize(
    ("places", "quantised"),
    [
        ([3, 3], [[1, 0, 0]] * 2),
        ([4, 3], [[1, 0, 0]] * 2),
        ([10], [[1, 0, 0]]),
        ([-1], [[1, 0, 0]]),
        ([3], [[0, 0, 0]]),
        ([3], [[0, 0, 2**40 + 1]]),
        ([3], [[0, 0, -(2**63)]]),
        ([3], [[1, 0, 0]] * 2),
    ],
)
def test_invalid_residuals_are_not_encoded(places: list[int], quantised: list[list[int]]) -> None:
    with pytest.raises(ValueError, match="residual"):
        encode_residuals(of_frames([(places, quantised)], {}), starts_of(10, 4))


def test_bytes_after_the_residuals_are_refused() -> None:
    group, starts = example()
    with pytest.raises(CorruptFileError, match="does not end"):
        read_residuals(encode_residuals(group, starts) + b"\1" * 8, 6, starts.tolist())
