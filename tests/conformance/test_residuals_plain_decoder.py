"""The decoder written from the specification reads residuals as the compiled one does."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from pdecodec._core import Residuals
from pdecodec.codec.sections.residuals import encode_residuals
from pdecodec.mesh.arrays import Int64Array
from spec.decoder.fields import CorruptFileError
from spec.decoder.residuals import read_residuals
from tests.support.residual_cases import example, groups, of_field, starts_of, walk


def assert_read_alike(group: Residuals, starts: Int64Array) -> None:
    data = encode_residuals(group, starts)
    for frame, plain in enumerate(read_residuals(data, group.frames, starts.tolist())):
        some = slice(group.frame_starts[frame], group.frame_starts[frame + 1])
        raw = slice(group.raw_frame_starts[frame], group.raw_frame_starts[frame + 1])
        assert list(plain.levels) == group.places[some].tolist()
        assert [list(steps) for steps in plain.levels.values()] == group.quantised[some].tolist()
        assert list(plain.raw) == group.raw_places[raw].tolist()
        assert [list(position) for position in plain.raw.values()] == group.raw_positions[raw].tolist()


@settings(max_examples=40)
@given(groups())
def test_residuals_are_read_alike(case: tuple[Residuals, Int64Array]) -> None:
    assert_read_alike(*case)


@pytest.mark.parametrize("spread", [0.6, 1e3, 1e11])
def test_residuals_that_are_predicted_are_read_alike(spread: float) -> None:
    assert_read_alike(of_field(walk(1, 12, 90, spread, 0.2)), starts_of(90, 32))


def test_residuals_of_a_cycle_are_read_alike() -> None:
    turn = np.rint(np.random.default_rng(2).normal(size=(6, 40, 3)) * 30).astype(np.int64)
    assert_read_alike(of_field(np.tile(turn, (3, 1, 1))), starts_of(40, 20))


def test_bytes_after_the_residuals_are_refused() -> None:
    group, starts = example()
    with pytest.raises(CorruptFileError, match="does not end"):
        read_residuals(encode_residuals(group, starts) + b"\1" * 8, 6, starts.tolist())
