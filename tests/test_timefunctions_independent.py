"""The independent decoder of functions of time gives what the library gives, to the last bit, of any bytes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_timefunctions import LARGEST, any_functions, assert_same_bits, swings, wanderings

from pdecodec._core import time_function_values
from pdecodec.errors import CorruptFileError
from pdecodec.timefunctions import (
    PREDICTED,
    STRAIGHT,
    TRANSFORMED,
    Float64Array,
    decode_time_functions,
    quantised_by_each_method,
)
from spec.decoder import timefunctions as independent
from spec.decoder.fields import CorruptFileError as IndependentCorruptFileError


def independently_decoded(data: bytes, frames: int, count: int, step: float, axes: int = 3) -> Float64Array:
    decoded = np.array(independent.read_time_functions(data, frames, count, step, axes)).reshape(count, axes, frames)
    return np.ascontiguousarray(decoded.transpose(2, 1, 0))


def assert_all_methods_agree(scaled: Float64Array, step: float) -> None:
    frames, axes, count = scaled.shape
    for item in quantised_by_each_method(scaled, step):
        assert_same_bits(independently_decoded(item.to_bytes(), frames, count, step, axes), item.decoded)


@settings(max_examples=25, deadline=None)
@given(any_functions())
def test_it_decodes_any_functions_by_all_methods(scaled: Float64Array) -> None:
    assert_all_methods_agree(scaled, 1.0)


@pytest.mark.parametrize(
    "scaled",
    [wanderings(60, 5), swings(60, 5), wanderings(60, 5)[:, :1], swings(60, 5)[:, 1:2]],
    ids=["wanderings", "swings", "wanderings the same on all axes", "swings the same on all axes"],
)
def test_it_decodes_functions_from_which_much_was_learnt(scaled: Float64Array) -> None:
    assert_all_methods_agree(scaled, 0.37)


@settings(max_examples=40, deadline=None)
@given(st.sampled_from([PREDICTED, TRANSFORMED, STRAIGHT]), st.binary(max_size=60))
def test_it_makes_the_same_of_bytes_that_nobody_wrote(method: int, content: bytes) -> None:
    data = bytes([method]) + content
    try:
        mine = decode_time_functions(data, 9, 4, 0.5)
    except CorruptFileError:
        with pytest.raises(IndependentCorruptFileError):
            independent.read_time_functions(data, 9, 4, 0.5)
        return
    assert np.isfinite(mine).all()
    assert_same_bits(independently_decoded(data, 9, 4, 0.5), mine)


def test_it_begins_anew_where_a_prediction_runs_away() -> None:
    numbers = np.full((3, 40, 3), LARGEST)
    theirs = np.array(independent.predicted(numbers.tolist(), 40))
    assert_same_bits(time_function_values(PREDICTED, numbers, 1.0), np.ascontiguousarray(theirs.transpose(2, 1, 0)))
