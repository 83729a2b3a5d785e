"""The independent decoder of functions of time gives what the library gives, to the last bit, of any bytes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec._core import time_function_values
from pdecodec.codec.sections.time_functions import PREDICTED, STRAIGHT, TRANSFORMED, quantised_by_each_method
from pdecodec.errors import CorruptFileError
from pdecodec.mesh.arrays import Float64Array
from spec.decoder import timefunctions as independent
from spec.decoder.fields import CorruptFileError as IndependentCorruptFileError
from tests.codec.test_timefunctions import (
    LARGEST,
    any_functions,
    assert_same_bits,
    decode_time_functions,
    swings,
    wanderings,
)


def independently_decoded(data: bytes, frames: int, count: int, step: float, axes: int = 3) -> Float64Array:
    decoded = independent.read_time_functions(data, frames, count, step, axes)
    return np.ascontiguousarray(decoded.transpose(1, 2, 0))


def assert_agree(found: Float64Array, data: bytes, expected: Float64Array) -> None:
    """To the bit, where arithmetic is exact."""
    if data[:1] == bytes([TRANSFORMED]):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13 * np.abs(expected).max())
    else:
        assert_same_bits(found, expected)


def assert_all_methods_agree(scaled: Float64Array, step: float) -> None:
    frames, axes, count = scaled.shape
    for item in quantised_by_each_method(scaled, step):
        data = item.to_bytes()
        assert_agree(independently_decoded(data, frames, count, step, axes), data, item.decoded)


@settings(max_examples=25)
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


@settings(max_examples=40)
@given(st.sampled_from([PREDICTED, TRANSFORMED, STRAIGHT]), st.binary(max_size=60))
def test_it_makes_the_same_of_bytes_that_nobody_wrote(method: int, content: bytes) -> None:
    data = bytes([method]) + content
    try:
        mine = decode_time_functions(data, 9, 4, 0.5)
    except CorruptFileError:
        with pytest.raises(IndependentCorruptFileError):
            independent.read_time_functions(data, 9, 4, 0.5)
        return
    theirs = independent.stored_functions(data, 9, 4, 0.5, 3)
    np.testing.assert_allclose(mine, theirs, rtol=1e-12, atol=1e-13)


def test_it_begins_anew_where_a_prediction_runs_away() -> None:
    numbers = np.full((3, 40, 3), LARGEST)
    theirs = np.ascontiguousarray(independent.predicted(numbers).transpose(1, 2, 0))
    assert_same_bits(time_function_values(PREDICTED, numbers, 1.0), theirs)
