"""Chunks of fields: encoded values are restored within the step, on any domain, and damage is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pdecodec import CorruptFileError, _core
from pdecodec.codec.encode.field.chunks import PREDICTIONS, TRANSFORMS, choose_coding, encode_chunk, field_quantiser
from spec.decoder.fieldchunks import neighbours_of_rows, read_chunk
from spec.decoder.fields import CorruptFileError as PlainError
from spec.decoder.mesh import Mesh

DOMAINS = {"vertex": 0, "face": 1, "corner": 2, "object": 3}
NONE, NO_SHAPES = np.zeros(0, np.int32), np.zeros(0, np.uint8)


def grid(columns: int, rows: int) -> tuple[Any, ...]:
    """Return connectivity for the core: a grid of quads, an edge along its first row, and a separate vertex."""
    first = np.arange(columns * rows, dtype=np.int32).reshape(rows, columns)
    quads = np.stack([first[:-1, :-1], first[:-1, 1:], first[1:, 1:], first[1:, :-1]], axis=-1).reshape(-1, 4)
    sizes = np.full(len(quads), 4, np.int32)
    line = first[0, :2].copy()
    return (columns * rows + 1, sizes, quads.ravel(), np.array([line.size], np.int32), line, NO_SHAPES, NONE, NONE)


def mesh_of(part: tuple[Any, ...]) -> Mesh:
    vertices, *numbers = part
    sizes, faces, line_sizes, lines = (one.tolist() for one in numbers[:4])
    return Mesh(
        "",
        vertices,
        [faces[at : at + 4] for at in range(0, 4 * len(sizes), 4)],
        [lines[: line_sizes[0]]],
    )


PARTS = [grid(4, 3), grid(2, 2)]
MESHES = [mesh_of(part) for part in PARTS]


def rows_of(domain: str) -> _core.FieldRows:
    return _core.FieldRows(DOMAINS[domain], PARTS)


@pytest.mark.parametrize(("domain", "rows"), [("vertex", 18), ("face", 7), ("corner", 28), ("object", 2)])
def test_a_domain_has_the_rows_of_all_objects(domain: str, rows: int) -> None:
    assert rows_of(domain).count == rows


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_values_come_back_within_half_the_step_and_with_their_kinds(data: st.DataObject) -> None:
    at = rows_of(data.draw(st.sampled_from(sorted(DOMAINS))))
    shape = (data.draw(st.integers(1, 9)), at.count, data.draw(st.integers(1, 4)))
    largest = data.draw(st.sampled_from([1, 20, 2**16, 2**36]))
    values = data.draw(arrays.arrays(np.int64, shape, elements=st.integers(-largest, largest)))
    kinds = data.draw(st.none() | arrays.arrays(np.uint8, shape, elements=st.integers(0, 3)))
    step = data.draw(st.sampled_from([1, 15, 255]))
    chunk = _core.encode_field_chunk(at, values, kinds, data.draw(st.integers(0, 8)), step)
    found = _core.decode_field_chunk(at, chunk, shape[0], shape[2])
    numbers = np.ones(shape, bool) if kinds is None else kinds == 0
    assert np.abs(found.values - values)[numbers].max(initial=0) <= step // 2
    assert (found.kinds is None) == (kinds is None)
    if kinds is not None:
        assert np.array_equal(found.kinds, kinds)


@settings(max_examples=25, deadline=None)
@given(st.data())
def test_the_plain_decoder_finds_the_same(data: st.DataObject) -> None:
    domain = data.draw(st.sampled_from(sorted(DOMAINS)))
    at, rng = rows_of(domain), np.random.default_rng(data.draw(st.integers(0, 2**32)))
    shape = (data.draw(st.integers(1, 12)), at.count, data.draw(st.integers(1, 3)))
    largest = data.draw(st.sampled_from([1, 5, 300, 2**36]))
    values = rng.integers(-largest, largest + 1, shape)
    values[:, ::2] = np.sort(values[:, ::2], axis=0)
    values[rng.integers(0, shape[0]) :] = values[0]
    kinds = data.draw(st.none() | st.just(rng.choice(4, shape, p=[0.7, 0.1, 0.1, 0.1]).astype(np.uint8)))
    chunk = _core.encode_field_chunk(
        at, values, kinds, data.draw(st.integers(0, 4)), data.draw(st.sampled_from([1, 15]))
    )
    found = _core.decode_field_chunk(at, chunk, shape[0], shape[2])
    read = read_chunk(chunk, neighbours_of_rows(domain, MESHES), shape[0], shape[2])
    assert np.array_equal(found.values.ravel(), np.ravel(read.values))
    assert read.kinds is None if kinds is None else np.array_equal(kinds.ravel(), np.ravel(read.kinds or []))


@pytest.mark.parametrize("domain", DOMAINS)
def test_frames_that_repeat_cost_next_to_nothing(domain: str) -> None:
    at = rows_of(domain)
    frame = np.random.default_rng(0).integers(-1000, 1000, (1, at.count, 2))
    still = [len(_core.encode_field_chunk(at, np.repeat(frame, n, axis=0), None, 0, 1)) for n in (1, 200)]
    assert still[1] - still[0] <= 12


def test_a_smooth_field_costs_less_with_frames_between_frames() -> None:
    at = rows_of("vertex")
    times = np.arange(65)[:, None, None] / 10
    values = np.rint(1e4 * np.sin(times + np.arange(at.count)[:, None] / 5)).astype(np.int64)
    sizes = {levels: len(_core.encode_field_chunk(at, values, None, levels, 15)) for levels in (0, 4)}
    assert sizes[4] < sizes[0]


def waves(at: _core.FieldRows, frames: int) -> np.ndarray:
    """Return a field of two functions of time, a little noise, and two components."""
    times, rows = np.arange(frames)[:, None, None] / 20, np.arange(at.count)[:, None] / 9
    noise = np.random.default_rng(2).uniform(-1e-4, 1e-4, (frames, at.count, 2))
    return (np.sin(times + rows * [1, 2]) + noise).astype(np.float32)


def test_few_functions_of_time_cost_less_and_keep_the_bound() -> None:
    at, values = rows_of("vertex"), waves(rows_of("vertex"), 120)
    quantiser = field_quantiser(values.dtype, -1.0, 1.0, 1e-3)
    coding, motion = choose_coding(at, quantiser, values)
    assert coding in TRANSFORMS
    chunks = [encode_chunk(at, quantiser, values, one) for one in (coding, *PREDICTIONS)]
    assert encode_chunk(at, quantiser, values, coding, motion) == chunks[0]
    assert len(chunks[0]) < 0.8 * min(len(one) for one in chunks[1:])
    for chunk in chunks:
        found = _core.decode_field_chunk(at, chunk, 120, 2)
        assert np.abs(quantiser.restore(found) - values).max() <= 1e-3


def test_the_plain_decoder_finds_the_same_transform() -> None:
    at = rows_of("face")
    quantiser = field_quantiser(np.dtype("f4"), -1.0, 1.0, 1e-3)
    chunk = encode_chunk(at, quantiser, waves(at, 16), TRANSFORMS[0])
    assert chunk[0] == 32
    found, read = (
        _core.decode_field_chunk(at, chunk, 16, 2),
        read_chunk(chunk, neighbours_of_rows("face", MESHES), 16, 2),
    )
    assert (np.ravel(read.values).tolist(), read.step) == (found.values.ravel().tolist(), found.step)


def test_damaged_transforms_are_refused() -> None:
    at = rows_of("vertex")
    quantiser = field_quantiser(np.dtype("f4"), -1.0, 1.0, 1e-3)
    data = encode_chunk(at, quantiser, waves(at, 20), TRANSFORMS[0])
    assert data[0] == 32
    for place, value in ((1, 0), (1, 65), (2, 23), (4, 255), (10, 2)):
        damaged = data[:place] + bytes([value]) + data[place + 1 :]
        with pytest.raises(CorruptFileError):
            _core.decode_field_chunk(at, damaged, 20, 2)
        with pytest.raises(PlainError):
            read_chunk(damaged, neighbours_of_rows("vertex", MESHES), 20, 2)


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_every_value_is_within_the_bound_or_exact(data: st.DataObject) -> None:
    dtype = np.dtype(data.draw(st.sampled_from(["f4", "f8", "i1", "u2", "i4", "u4", "i8", "u8", "?"])))
    at = rows_of("face")
    values = data.draw(arrays.arrays(dtype, (3, at.count, 2)))
    finite = values[np.isfinite(values)].astype(np.float64)
    least, most = float(finite.min(initial=0)), float(finite.max(initial=0))
    bound = data.draw(st.none() | st.sampled_from([1e-2, 1e-7])) if dtype.kind == "f" else None
    span = min(most - least, 1e300)
    quantiser = field_quantiser(dtype, least, most, None if bound is None else bound * span)
    coding, motion = choose_coding(at, quantiser, values)
    chunk = _core.decode_field_chunk(at, encode_chunk(at, quantiser, values, coding, motion), 3, 2 * quantiser.planes)
    found = quantiser.restore(chunk)
    assert found.dtype == dtype
    if quantiser.step is None:
        assert found.tobytes() == values.tobytes()
    else:
        numbers = np.isfinite(values)
        assert np.array_equal(found[~numbers], values[~numbers], equal_nan=True)
        assert np.abs(found[numbers].astype(np.float64) - values[numbers]).max(initial=0) <= bound * span


def test_damaged_chunks_are_refused() -> None:
    at = rows_of("vertex")
    values = np.random.default_rng(1).integers(-50, 50, (3, at.count, 1))
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
