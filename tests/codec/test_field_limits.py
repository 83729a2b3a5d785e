"""Extreme fields: files that ask for much memory or time, and the largest values."""

from __future__ import annotations

import resource
import time
import zlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

import pdecodec
from pdecodec import (
    ArraySequence,
    Connectivity,
    CorruptFileError,
    DecodeLimits,
    Field,
    LimitError,
    MeshObject,
    _core,
)
from pdecodec.codec.sections.fields import (
    HALVES,
    VELOCITY,
    FieldEntry,
    FieldGroupEntry,
    computed_group,
    encode_field_headers,
)
from pdecodec.codec.settings import EXACT
from pdecodec.mesh.fields import held_or_mixed
from spec.sealing import seal, take_apart

FRAMES = 64


def file_with(entries: Sequence[FieldEntry], chunks: bytes, clip: ArraySequence | None = None) -> bytes:
    """Return a file whose fields are replaced by others."""
    clip = clip or ArraySequence(np.zeros((FRAMES, 3, 3)))
    fields = [(Field("any", "object"), np.zeros((clip.frame_count, len(clip.objects))))]
    data = pdecodec.encode(ArraySequence(clip.points, objects=clip.objects, fields=fields)).data
    assert data is not None
    changed = {"FLDS": encode_field_headers(entries), "FDAT": chunks}
    return seal([replace(part, content=changed.get(part.kind, part.content)) for part in take_apart(data)])


def test_predictors_of_functions_of_time_count_as_memory() -> None:
    chunk = bytes([32, 64])  # 64 functions of time, for each of 2^16 components of two numbers
    group = FieldGroupEntry(FRAMES, 0, 1, HALVES, 0.0, len(chunk), zlib.crc32(chunk))
    entry = FieldEntry(Field("a", "object", np.dtype("f8"), 2**16), 0.0, 0.0, 0.0, [group])
    data, limits = file_with([entry], chunk), DecodeLimits(max_memory=2**30)
    with pdecodec.open(data, limits=limits) as animation, pytest.raises(LimitError, match="a group of field a"):
        animation.read_field("a", 0, 1)


def test_chunks_without_rows_take_no_memory() -> None:
    rows = _core.FieldRows(3, [])
    values = np.zeros((64, 0, 2), np.int64)
    functions, digits = np.zeros((64, 1, 64), np.int64), np.zeros(64, np.uint8)
    chunk = _core.encode_transformed_field_chunk(rows, values, functions, np.zeros((0, 2, 64), np.int64), digits, 0, 1)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert _core.decode_field_chunk(rows, chunk, 64, 2**17).values.size == 0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2**16  # [KiB]; predictors would take 1.6 GiB


FACES = 2000
SUBSETS = [(0,), (1,), (0, 1), (0, 2), (1, 2), (0, 1, 2)]


@pytest.fixture(scope="module")
def crowded() -> bytes:
    """Return a file of three objects of few vertices and many faces, with fields of several sets of objects."""
    faces = Connectivity.from_padded(3, np.tile(np.int32([0, 1, 2]), (FACES, 1)))
    random = np.random.default_rng(0).random
    fields = [
        (Field(f"{domain}{owners}", domain, objects=owners), random((1, rows * len(owners))))
        for owners in SUBSETS
        for domain, rows in (("corner", 3 * FACES), ("vertex", 3), ("object", 1))
    ]
    clip = ArraySequence(np.zeros((1, 9, 3)), objects=[MeshObject(str(k), faces) for k in range(3)], fields=fields)
    data = pdecodec.encode(clip, fields={one.name: EXACT for one, _ in fields}).data
    assert data is not None
    return data


def read_once(animation: pdecodec.Animation, name: str) -> None:
    """Read a field, or "positions"."""
    if name == "positions":
        animation.read_frames(0, 1)
    else:
        animation.read_field(name, 0, 1)


def least_memory(data: bytes, name: str) -> int:
    """Return the smallest memory limit with which a field, or "positions", can be read [bytes], to 1 KiB."""
    low, high = 0, 1 << 26
    while high - low > 1024:
        middle = (low + high) // 2
        try:
            with pdecodec.open(data, limits=DecodeLimits(max_memory=middle)) as animation:
                read_once(animation, name)
            high = middle
        except LimitError:
            low = middle
    return high


def test_tables_of_neighbours_count_as_memory(crowded: bytes) -> None:
    owners = SUBSETS[-1]
    linked, alone = (least_memory(crowded, f"{domain}{owners}") for domain in ("vertex", "object"))
    assert linked - alone > 20 * 3 * FACES * len(owners)


def test_a_field_that_fits_alone_fits_after_other_fields(crowded: bytes) -> None:
    largest = f"corner{SUBSETS[-1]}"
    limits = DecodeLimits(max_memory=least_memory(crowded, largest))
    with pdecodec.open(crowded, limits=limits) as animation, pdecodec.open(crowded) as unlimited:
        for name in [one.name for one in animation.fields] + [largest]:
            expected = unlimited.read_field(name, 0, 1)
            np.testing.assert_array_equal(animation.read_field(name, 0, 1), expected, name)


def test_positions_and_fields_make_room_for_each_other() -> None:
    random = np.random.default_rng(2).random
    fields = {name: random((FRAMES, 2000)) for name in ("a", "b")}
    data = pdecodec.encode(ArraySequence(random((FRAMES, 2000, 3)), fields=fields), effort="fast").data
    assert data is not None
    least = [least_memory(data, name) for name in ("positions", "a", "b")]
    both = max(least) + min(least) // 4
    assert both < sum(least[:2]) - 2**16
    with pdecodec.open(data, limits=DecodeLimits(max_memory=both)) as animation:
        for name in ("positions", "a", "b", "positions", "b", "a", "positions"):
            read_once(animation, name)


def test_headers_of_many_fields_take_no_quadratic_time() -> None:
    names = [f"{number:01000}" for number in range(15000)]
    group = computed_group(FRAMES, VELOCITY)
    entries = [FieldEntry(Field(name, "vertex", components=3), 0.0, 0.0, 1.0, [group]) for name in names]
    with pdecodec.open(file_with(entries, b"")) as animation:
        before = time.process_time()
        assert len(animation.stored_fields) == len(names)
        assert time.process_time() - before < 1.0


def test_only_a_deep_check_decodes_the_motion_of_computed_fields() -> None:
    entry = FieldEntry(Field("a", "vertex", components=3), 0.0, 0.0, 1.0, [computed_group(FRAMES, VELOCITY)])
    parts = take_apart(file_with([entry], b"", ArraySequence(np.random.default_rng(1).random((FRAMES, 3, 3)))))
    damaged = seal(
        [replace(part, content=part.content[:-1] + b"\xff") if part.kind == "COEF" else part for part in parts]
    )
    with pdecodec.open(damaged) as animation:
        animation.check_field_group(0, 0)
        with pytest.raises(CorruptFileError):
            animation.check_field_group(0, 0, deep=True)


def test_functions_of_time_beyond_the_largest_number_are_not_used() -> None:
    frames = 200
    values = np.zeros((frames, 201))
    values[:, 0], values[0] = 1.0, 1.0
    values[:, 1] += 1e-9 * np.sin(np.arange(frames))
    clip = ArraySequence(np.zeros((frames, 201, 3)), fields={"a": values})
    report = pdecodec.encode(clip, fields={"a": "3e-10 units"})
    assert report.data is not None
    with pdecodec.open(report.data) as animation:
        assert np.abs(animation.read_field("a", 0, frames) - values).max() <= 3e-10


@pytest.mark.filterwarnings("error")
def test_the_largest_floats_overflow_silently() -> None:
    largest = np.finfo(np.float64).max
    values = np.array([[largest, -largest, 1.0], [-largest, largest, np.inf], [largest, 0.0, 2.0]])
    clip = ArraySequence(np.zeros((3, 3, 3)), fields={"a": values})
    data = pdecodec.encode(clip, field_tolerance=1e-2).data
    assert data is not None
    with pdecodec.open(data) as animation:
        np.testing.assert_array_equal(animation.read_field("a", 0, 3), values)
    np.testing.assert_array_equal(held_or_mixed(clip.fields[0], values[0], values[1], 0.5), [largest, -largest, 1.0])
