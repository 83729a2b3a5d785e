"""The adaptive range coder: what goes in comes out, at the cost it says, and no bytes make it misbehave."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pdecodec.kernels.rangecoder import (
    COST,
    COST_BITS,
    COUNT_BITS,
    COUNT_MASK,
    ENCODE,
    EVEN,
    FIRST_BYTES,
    LEAST,
    LOW,
    MEASURE,
    POSITION,
    RANGE,
    SLOWEST,
    TOP,
    adapted,
    code_bit,
    code_mixed,
    code_with,
    finish,
    is_finished,
    new_coder,
    new_decoder,
)
from pdecodec.kernels.uncounted import uncounted
from spec.decoder.rangecoder import RangeDecoder
from spec.decoder.rangecoder import adapted as plainly_adapted

Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

CELLS = 8
SETS = 2
OPINIONS = 3

EVENLY, CELL, MIXED = range(3)
"""Kinds of bits in a program of the tests."""


@uncounted
def run(coder: Int64Array, data: UInt8Array, cells: Int64Array, weights: Int64Array, program: Int64Array,
        bits: Int64Array) -> None:  # fmt: skip
    """Code `bits` as `program` says, rows of kind, probability, set of weights, three cells; they are written back."""
    for i in range(bits.size):
        if program[i, 0] == EVENLY:
            bits[i] = code_with(coder, data, program[i, 1], bits[i])
        elif program[i, 0] == CELL:
            bits[i] = code_bit(coder, data, cells, program[i, 3], bits[i])
        else:
            chosen = program[i, 3], program[i, 4], program[i, 5]
            bits[i] = code_mixed(coder, data, cells, chosen, weights[program[i, 2]], bits[i])


def fresh() -> tuple[Int64Array, Int64Array]:
    """Cells and weights."""
    return np.full(CELLS, EVEN, np.int64), np.full((SETS, OPINIONS), 65536 // OPINIONS, np.int64)


def encoded(program: Int64Array, bits: Int64Array, *, room: int | None = None) -> tuple[bytes, int]:
    """The bytes that there was room for, and how many there are in all."""
    coder = new_coder(ENCODE)
    data = np.zeros(bits.size * 2 + 16 if room is None else room, np.uint8)
    run(coder, data, *fresh(), program, bits.copy())
    size = finish(coder, data)
    return data[:size].tobytes(), size


def decoded(data: bytes, program: Int64Array) -> tuple[Int64Array, Int64Array]:
    """The bits, and the decoder's state after them."""
    array = np.frombuffer(bytearray(data), np.uint8)
    coder = new_decoder(array)
    bits = np.zeros(len(program), np.int64)
    run(coder, array, *fresh(), program, bits)
    return bits, coder


def measured(program: Int64Array, bits: Int64Array) -> float:
    """Cost in bits."""
    coder = new_coder(MEASURE)
    run(coder, np.zeros(1, np.uint8), *fresh(), program, bits.copy())
    return float(coder[COST]) / 2**COST_BITS


def programs_of(random: np.random.Generator, size: int) -> Int64Array:
    kinds = random.integers(0, 3, size)
    probabilities = random.integers(LEAST, 65536 - LEAST, size, endpoint=True)
    sets = random.integers(0, SETS, size)
    cells = random.permuted(np.broadcast_to(np.arange(CELLS), (size, CELLS)), axis=1)
    return np.column_stack([kinds, probabilities, sets, cells[:, :OPINIONS]]).astype(np.int64)


def cell_program(cells: Int64Array) -> Int64Array:
    """Bits of one cell each."""
    zeros = np.zeros_like(cells)
    return np.column_stack([zeros + CELL, zeros, zeros, cells, zeros, zeros])


@st.composite
def sessions(draw: st.DrawFn) -> tuple[Int64Array, Int64Array]:
    """A program and its bits, from even ones to such as never change."""
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    size = draw(st.integers(0, 600))
    share = draw(st.sampled_from([0.0, 0.001, 0.1, 0.5, 0.9, 1.0]))
    return programs_of(random, size), (random.random(size) < share).astype(np.int64)


@settings(max_examples=150, deadline=None)
@given(sessions())
def test_bits_come_back_and_not_a_byte_is_too_many(session: tuple[Int64Array, Int64Array]) -> None:
    program, bits = session
    data, size = encoded(program, bits)
    found, coder = decoded(data, program)
    assert found.tolist() == bits.tolist()
    assert size <= coder[POSITION] <= size + FIRST_BYTES
    assert is_finished(coder, np.frombuffer(data, np.uint8))
    shorter = [data[:-1]] if data else []
    for other in (*shorter, data + b"\0", data + b"\1", data + b"\xff", data + bytes(FIRST_BYTES + 1)):
        found, coder = decoded(other, program)
        assert found.tolist() != bits.tolist() or not is_finished(coder, np.frombuffer(other, np.uint8))


@settings(max_examples=60, deadline=None)
@given(sessions(), st.binary(max_size=80))
def test_the_plain_decoder_reads_the_same_bits_from_any_bytes(
    session: tuple[Int64Array, Int64Array], noise: bytes
) -> None:
    program, bits = session
    for data in (encoded(program, bits)[0], noise):
        reader = RangeDecoder(data)
        cells, weights = (array.tolist() for array in fresh())
        found = []
        for kind, probability, chosen_set, *chosen in program.tolist():
            if kind == EVENLY:
                found.append(reader.bit_with(probability))
            elif kind == CELL:
                found.append(reader.bit(cells, chosen[0]))
            else:
                found.append(reader.mixed(cells, chosen, weights[chosen_set]))
        mine, coder = decoded(data, program)
        assert found == mine.tolist()
        assert reader.taken == coder[POSITION]
        assert reader.is_finished() == is_finished(coder, np.frombuffer(data, np.uint8))


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, SLOWEST), st.integers(0, 1))
def test_cells_adapt_as_the_plain_form_and_stay_probabilities(value: int, count: int, bit: int) -> None:
    cell = (value >> COUNT_BITS << COUNT_BITS) | count
    after = int(adapted(cell, bit, SLOWEST))
    assert after == plainly_adapted(cell, bit)
    assert 0 <= after >> COUNT_BITS < 2**22
    assert after & COUNT_MASK == min(count + 1, SLOWEST)


def sources() -> Iterator[tuple[str, Int64Array, Int64Array, float]]:
    """Name, cells, bits, and the cost in bits that knowing the source's statistics would lead to."""
    random = np.random.default_rng(7)
    size = 60000
    for share in (0.5, 0.2, 0.03):
        bits = (random.random(size) < share).astype(np.int64)
        yield f"one cell, {share}", np.zeros(size, np.int64), bits, size * entropy(share)
    cells = random.integers(0, CELLS, size)
    shares = np.linspace(0.01, 0.9, CELLS)
    bits = (random.random(size) < shares[cells]).astype(np.int64)
    yield "a cell for each context", cells, bits, float(sum(entropy(share) for share in shares[cells]))


def entropy(share: float) -> float:
    return -share * math.log2(share) - (1 - share) * math.log2(1 - share)


@pytest.mark.parametrize(("name", "cells", "bits", "ideal"), list(sources()), ids=[each[0] for each in sources()])
def test_a_source_costs_within_three_per_cent_of_its_entropy(
    name: str, cells: Int64Array, bits: Int64Array, ideal: float
) -> None:
    size = encoded(cell_program(cells), bits)[1]
    assert 8 * size <= 1.03 * ideal


@pytest.mark.parametrize("share", [0.5, 0.1, 0.004])
def test_bytes_cost_what_the_probabilities_say(share: float) -> None:
    """Beside the logarithms of a cell's own probabilities, summed in plain Python."""
    bits = (np.random.default_rng(9).random(60000) < share).astype(np.int64)
    cell, ideal = EVEN, 0.0
    for bit in bits.tolist():
        probability = min(max((cell >> COUNT_BITS) / 2**22, LEAST / 2**16), 1 - LEAST / 2**16)
        ideal -= math.log2(probability if bit else 1 - probability)
        cell = plainly_adapted(cell, bit)
    size = encoded(cell_program(np.zeros(bits.size, np.int64)), bits)[1]
    assert 8 * size == pytest.approx(ideal, rel=0.005, abs=16)


@pytest.mark.parametrize("share", [0.5, 0.2, 0.03])
def test_the_measured_cost_is_that_of_the_bytes(share: float) -> None:
    random = np.random.default_rng(3)
    bits = (random.random(40000) < share).astype(np.int64)
    program = programs_of(random, bits.size)
    program[program[:, 0] == EVENLY, 1] = round(65536 * share)
    assert measured(program, bits) == pytest.approx(8 * encoded(program, bits)[1], rel=0.005)


def test_mixing_finds_the_opinion_that_knows() -> None:
    """Of three cells one follows the source; mixed they cost little more than that one alone."""
    random = np.random.default_rng(5)
    size = 40000
    state = random.integers(0, 2, size)
    bits = (random.random(size) < np.where(state, 0.95, 0.05)).astype(np.int64)
    zeros = np.zeros(size, np.int64)
    chosen = np.column_stack([state, 2 + random.integers(0, 3, size), zeros + 5])
    mixed = np.column_stack([zeros + MIXED, zeros, zeros, chosen])
    alone = 8 * encoded(cell_program(state), bits)[1]
    assert 8 * encoded(mixed, bits)[1] < 1.03 * alone
    assert alone < 0.35 * size


def test_a_carry_runs_through_bytes_that_are_full() -> None:
    """An interval just below the next byte: 0 moves its low end up, past every 255 already written."""
    for kept in range(5):
        coder = new_coder(ENCODE)
        data = np.zeros(20, np.uint8)
        data[0], data[1 : 1 + kept] = 7, 255
        coder[POSITION] = 1 + kept
        coder[LOW], coder[RANGE] = TOP - 16, TOP >> 4
        code_with(coder, data, 1 << 15, 0)
        assert data[: 1 + kept].tolist() == [8] + [0] * kept
        assert 0 <= coder[LOW] < TOP


def test_a_carry_out_of_the_last_bytes_runs_through_too() -> None:
    coder = new_coder(ENCODE)
    data = np.zeros(8, np.uint8)
    data[:3] = 41, 255, 255
    coder[POSITION] = 3
    coder[LOW], coder[RANGE] = TOP - 5, TOP >> 3
    assert finish(coder, data) == 3
    assert data[:3].tolist() == [42, 0, 0]


@pytest.mark.parametrize("probability", [LEAST, 65536 - LEAST])
def test_long_runs_of_what_was_least_expected_come_back(probability: int) -> None:
    """Both ends of the interval are narrowed as far as they go: what long carries are made of."""
    bits = np.tile([0, 0, 0, 1], 500).astype(np.int64) ^ int(probability == LEAST)
    program = np.zeros((bits.size, 6), np.int64)
    program[:, 1] = probability
    data, _ = encoded(program, bits)
    assert decoded(data, program)[0].tolist() == bits.tolist()


def test_nothing_takes_no_bytes_and_neither_do_bits_that_are_certain() -> None:
    assert encoded(np.zeros((0, 6), np.int64), np.zeros(0, np.int64)) == (b"", 0)
    ones = np.ones(3000, np.int64)
    data, size = encoded(cell_program(np.zeros(3000, np.int64)), ones)
    assert size <= 4
    assert decoded(data, cell_program(np.zeros(3000, np.int64)))[0].all()


@settings(max_examples=60, deadline=None)
@given(sessions(), st.integers(0, 60))
def test_a_buffer_too_short_is_noticed_and_not_written_beyond(
    session: tuple[Int64Array, Int64Array], room: int
) -> None:
    program, bits = session
    whole, size = encoded(program, bits)
    guarded = np.full(room + 16, 99, np.uint8)
    coder = new_coder(ENCODE)
    run(coder, guarded[:room], *fresh(), program, bits.copy())
    assert finish(coder, guarded[:room]) == size
    assert (guarded[room:] == 99).all()
    if room >= size:
        assert guarded[:size].tobytes() == whole


@settings(max_examples=80, deadline=None)
@given(sessions(), st.data())
def test_cut_or_garbled_bytes_give_bits_and_are_not_read_beyond(
    session: tuple[Int64Array, Int64Array], data: st.DataObject
) -> None:
    program, bits = session
    whole, _ = encoded(program, bits)
    cut = bytearray(whole[: data.draw(st.integers(0, len(whole)))])
    for at in range(0, len(cut), 7):
        cut[at] ^= data.draw(st.integers(0, 255))
    # What lies behind the bytes must not matter: zeros are read there.
    for behind in (0, 0xAA):
        room = np.full(len(cut) + 64, behind, np.uint8)
        room[: len(cut)] = np.frombuffer(bytes(cut), np.uint8)
        view = room[: len(cut)]
        coder = new_decoder(view)
        found = np.zeros(bits.size, np.int64)
        run(coder, view, *fresh(), program, found)
        assert set(found.tolist()) <= {0, 1}
        assert found.tolist() == decoded(bytes(cut), program)[0].tolist()


def test_bytes_too_many_are_noticed() -> None:
    program = cell_program(np.zeros(500, np.int64))
    bits = np.random.default_rng(2).integers(0, 2, 500)
    data, _ = encoded(program, bits)
    for other in (data + b"\0", data + bytes(FIRST_BYTES + 1)):
        assert not is_finished(decoded(other, program)[1], np.frombuffer(other, np.uint8))


def test_the_same_bits_give_the_same_bytes() -> None:
    random = np.random.default_rng(1)
    program, bits = programs_of(random, 3000), random.integers(0, 2, 3000)
    assert encoded(program, bits) == encoded(program, bits)
