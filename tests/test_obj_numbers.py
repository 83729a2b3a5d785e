"""Decimal text to float32 and back, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec.formats.decimal_text import (
    NUMBER_WIDTH,
    float32_of_token,
    format_rows,
    format_rows_plainly,
    parse_decimals,
)

finite = st.floats(width=32, allow_nan=False, allow_infinity=False)

decimal_tokens = st.builds(
    lambda sign, whole, fraction, exponent: f"{sign}{whole}{fraction}{exponent}".encode(),
    st.sampled_from(["", "-", "+"]),
    st.from_regex(r"[0-9]{1,25}", fullmatch=True),
    st.one_of(st.just(""), st.just("."), st.from_regex(r"\.[0-9]{1,30}", fullmatch=True)),
    st.one_of(st.just(""), st.integers(-80, 50).map(lambda power: f"e{power:+d}")),
)


def parse(tokens: list[bytes]) -> tuple[np.ndarray, np.ndarray]:
    text = np.frombuffer(b" ".join(tokens) + b"\n", np.uint8)
    starts = np.cumsum([0] + [len(token) + 1 for token in tokens[:-1]]).astype(np.int64)
    values, certain = np.empty(len(tokens), np.float32), np.empty(len(tokens), np.bool_)
    parse_decimals(text, starts, values, certain)
    return values, certain


def of_python(token: bytes) -> np.float32:
    with np.errstate(over="ignore", under="ignore"):
        return np.float32(float(token))


def format_fast(rows: np.ndarray) -> bytes:
    out = np.empty(rows.shape[0] * (2 + rows.shape[1] * NUMBER_WIDTH), np.uint8)
    length = format_rows(rows, ord("v"), out)
    assert length > 0
    return out[:length].tobytes()


@settings(deadline=None, max_examples=300)
@given(st.lists(decimal_tokens, min_size=1, max_size=20))
def test_a_certain_number_is_what_python_reads_rounded_to_float32(tokens: list[bytes]):
    values, certain = parse(tokens)
    expected = np.array([of_python(token) for token in tokens])
    assert np.array_equal(values[certain].view(np.uint32), expected[certain].view(np.uint32))


@settings(deadline=None, max_examples=200)
@given(st.lists(finite, min_size=1, max_size=20), st.sampled_from(["{!r}", "{:.6g}", "{:.9g}", "{:.17g}", "{:f}"]))
def test_numbers_as_programs_write_them_are_certain_and_right(numbers: list[float], form: str):
    tokens = [form.format(number).encode() for number in numbers if number == 0 or abs(number) > 1e-30]
    if tokens:
        values, certain = parse(tokens)
        assert certain.all()
        assert np.array_equal(values.view(np.uint32), np.array([of_python(t) for t in tokens]).view(np.uint32))


def test_a_number_halfway_between_two_floats_is_left_to_the_plain_form():
    halfway = b"1.000000059604644775390625"  # 1 + 2^-24, exactly
    beside = b"1.000000059604644775390626"
    values, certain = parse([halfway, beside, b"1.0000001"])
    assert certain.tolist() == [False, False, True]
    assert float32_of_token(halfway) == np.float32(1)
    assert values[2] == np.float32(1.0000001)


@pytest.mark.parametrize(
    ("token", "expected"),
    [
        (b"0", 0.0),
        (b"-0", -0.0),
        (b"5.", 5.0),
        (b".5", 0.5),
        (b"+1E2", 100.0),
        (b"1e39", np.inf),
        (b"-1e4000", -np.inf),
        (b"1e-50", 0.0),
        (b"1.401298464324817e-45", 1.401298464324817e-45),
        (b"0.00000000000000000000000000000000000000000000000001e50", 1.0),
        (b"123456789012345678901234567890", 123456789012345678901234567890.0),
    ],
)
def test_unusual_but_plain_numbers_are_read(token: bytes, expected: float):
    values, certain = parse([token])
    settled = values[0] if certain[0] else float32_of_token(token)
    with np.errstate(over="ignore"):
        assert np.float32(settled).tobytes() == np.float32(expected).tobytes()


@pytest.mark.parametrize("token", [b"nan", b"NaN", b"-nan(ind)", b"1.#QNAN", b"-1.#IND00"])
def test_not_a_number_is_read_in_every_spelling(token: bytes):
    assert parse([token])[1].tolist() == [False]
    value = float32_of_token(token)
    assert value is not None
    assert np.isnan(value)


@pytest.mark.parametrize(
    ("token", "sign"), [(b"inf", 1), (b"+Infinity", 1), (b"-inf", -1), (b"1.#INF", 1), (b"-1.#INF00", -1)]
)
def test_infinity_is_read_in_every_spelling(token: bytes, sign: int):
    assert parse([token])[1].tolist() == [False]
    assert float32_of_token(token) == sign * np.inf


@pytest.mark.parametrize(
    "token", [b"", b"-", b".", b"e5", b"1e", b"1e+", b"1.2.3", b"1,5", b"0x10", b"1_000", b"--1", b"1f", "١".encode()]
)
def test_what_is_no_number_is_never_taken_for_one(token: bytes):
    assert not parse([token])[1][0]
    assert float32_of_token(token) is None


def test_a_negative_start_gives_zero():
    values, certain = np.empty(1, np.float32), np.empty(1, np.bool_)
    parse_decimals(np.frombuffer(b"7\n", np.uint8), np.array([-1]), values, certain)
    assert (values[0], certain[0]) == (0, True)


@settings(deadline=None, max_examples=300)
@given(st.lists(finite, min_size=3, max_size=30))
def test_written_numbers_read_back_to_the_same_float32(numbers: list[float]):
    rows = np.array(numbers[: len(numbers) // 3 * 3], np.float32).reshape(-1, 3)
    for text in (format_fast(rows), format_rows_plainly(rows, b"v")):
        lines = text.decode().splitlines()
        assert [line[:2] for line in lines] == ["v "] * len(rows)
        back = np.array([[of_python(word.encode()) for word in line.split()[1:]] for line in lines])
        assert np.array_equal(back.view(np.uint32), rows.view(np.uint32))


@settings(deadline=None, max_examples=300)
@given(finite.filter(lambda number: abs(number) >= np.finfo(np.float32).tiny))
def test_no_written_normal_number_has_more_digits_than_the_shortest(number: float):
    text = format_fast(np.array([[number]], np.float32)).split()[1]
    digits = text.split(b"e")[0].strip(b"-").replace(b".", b"").strip(b"0")
    shortest = np.format_float_scientific(np.float32(number), unique=True).split("e")[0]
    assert len(digits) <= len(shortest.strip("-").replace(".", "").strip("0"))


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (0.0, b"0"),
        (-0.0, b"-0"),
        (0.1, b"0.1"),
        (-1.5, b"-1.5"),
        (100.0, b"100"),
        (123456792.0, b"123456790"),
        (1e9, b"1e+09"),
        (1e-4, b"0.0001"),
        (1.5e-5, b"1.5e-05"),
        (3.4028235e38, b"3.4028235e+38"),
    ],
)
def test_numbers_are_written_as_people_would(number: float, text: bytes):
    assert format_fast(np.array([[number]], np.float32)) == b"v " + text + b"\n"
