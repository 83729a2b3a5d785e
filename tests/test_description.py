"""Times to the last bit, names, attributes and remarks: back as they were, or our own error."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from damage import assert_cuts_are_refused, assert_only_corrupt_file_errors
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from mesh_cases import connectivity_of
from numpy.typing import NDArray
from sequence_cases import rich_sequence

from pdecodec.bytestream import FieldWriter
from pdecodec.description import (
    AT_FRAME_RATE,
    BYTES_PER_INDEX,
    BYTES_PER_JSON_BYTE,
    BYTES_PER_VALUE_BYTE,
    MAX_JSON_BYTES,
    TIMES_BY_PERIOD,
    TIMES_COUNTED,
    TIMES_LISTED,
    TIMES_STEPPED,
    VALUE_TYPES,
    decode_attributes,
    decode_remarks,
    decode_sequence_description,
    encode_attributes,
    encode_remarks,
    encode_sequence_description,
)
from pdecodec.entropy import compress, pack_integers
from pdecodec.errors import CorruptFileError, InputError, LimitError
from pdecodec.sequence import (
    LARGEST_TIME,
    MAX_INDEX,
    SHORTEST_TIME_STEP,
    ArraySequence,
    Attribute,
    Connectivity,
    MeshObject,
)

PLENTY = 2**30
"""Memory [bytes] that no test here comes near."""


def clip(times: NDArray[np.float64], fps: float | None = None) -> ArraySequence:
    return ArraySequence(np.zeros((len(times), 1, 3), np.float32), times=times, fps=fps)


def times_kind(data: bytes) -> int:
    """How the times are stored in version 2: the byte after frames and fps."""
    rule = data[8 + next(at + 1 for at, byte in enumerate(data) if byte < 128)]
    return rule - AT_FRAME_RATE if rule & AT_FRAME_RATE else rule


def assert_times_come_back(sequence: ArraySequence) -> int:
    data = encode_sequence_description(sequence, major=2)
    found = decode_sequence_description(data, sequence.frame_count, major=2)
    assert found.times.tobytes() == sequence.times.tobytes()
    assert found.fps == sequence.fps
    return times_kind(data)


@pytest.mark.parametrize("fps", [1.0, 23.976, 24.0, 24000 / 1001, 25.0, 29.97, 60.0, 1e-3, 1e4])
@pytest.mark.parametrize("start", [0, 1, 1001, -12])
@pytest.mark.parametrize("frames", [1, 2, 251])
def test_frames_at_a_rate_are_stored_as_a_rule_to_the_last_bit(fps: float, start: int, frames: int) -> None:
    kind = assert_times_come_back(clip((start + np.arange(frames)) / fps, fps))
    assert kind == TIMES_COUNTED


@pytest.mark.parametrize("start", [0.1, -3.7, 1e6])
def test_times_from_an_odd_start_are_stored_as_a_rule(start: float) -> None:
    assert assert_times_come_back(clip(start + np.arange(100) / 24.0, 24.0)) in (TIMES_STEPPED, TIMES_COUNTED)


def test_a_rate_other_than_the_nominal_one_is_found() -> None:
    assert assert_times_come_back(clip(np.arange(50) / 30.0, 24.0)) == TIMES_COUNTED


def test_whole_periods_added_up_are_a_rule_of_version_2_only() -> None:
    sequence = clip(1 / 24 + np.arange(200) * (1 / 24), 24.0)
    assert assert_times_come_back(sequence) == TIMES_BY_PERIOD
    assert encode_sequence_description(sequence, major=1)[16] == TIMES_LISTED
    by_period = struct.pack("<QdBddIQQ", 200, 24.0, TIMES_BY_PERIOD, 1 / 24, 24.0, 1, 1, 0)
    with pytest.raises(CorruptFileError, match="unknown way"):
        decode_sequence_description(by_period, 200, major=1)


@pytest.mark.parametrize("frames", [1, 2, 300])
def test_both_versions_say_the_same_of_times_and_objects(frames: int) -> None:
    objects = [MeshObject("one", Connectivity(3)), MeshObject("two", Connectivity(200))]
    times = np.arange(frames) / 25
    sequence = ArraySequence(np.zeros((frames, 203, 3), np.float32), objects=objects, times=times, fps=25.0)
    found = []
    for major in (1, 2):
        data = encode_sequence_description(sequence, major=major)
        found.append(decode_sequence_description(data, frames, major=major))
    assert found[0].times.tobytes() == found[1].times.tobytes() == times.tobytes()
    assert (found[0].names, found[0].vertex_counts) == (found[1].names, found[1].vertex_counts)


def test_times_that_a_rule_would_give_but_for_one_bit_are_listed() -> None:
    times = np.arange(50) / 24.0
    times[17] = np.nextafter(times[17], 10)
    assert assert_times_come_back(clip(times, 24.0)) == TIMES_LISTED


@settings(max_examples=80, deadline=None)
@given(st.lists(st.floats(-LARGEST_TIME, LARGEST_TIME) | st.floats(-2, 2), min_size=1, max_size=12, unique=True))
def test_any_times_come_back_to_the_last_bit(values: list[float]) -> None:
    chosen: list[float] = []
    for time in sorted(value + 0.0 for value in values):  # a zero without a sign
        if not chosen or time - chosen[-1] >= SHORTEST_TIME_STEP:
            chosen.append(time)
    assert_times_come_back(clip(np.array(chosen)))


def test_names_and_vertex_counts_come_back() -> None:
    names = ["", "body", "ünï 二\n", "body"]
    objects = [MeshObject(name, Connectivity(k)) for k, name in enumerate(names)]
    sequence = ArraySequence(np.zeros((2, 6, 3)), objects=objects)
    found = decode_sequence_description(encode_sequence_description(sequence, major=2), 2, major=2)
    assert found.names == tuple(names)
    assert found.vertex_counts == (0, 1, 2, 3)


def irregular() -> bytes:
    return encode_sequence_description(rich_sequence(6), major=2)


def test_a_description_that_is_cut_or_too_long_is_refused() -> None:
    assert_cuts_are_refused(irregular(), lambda data: decode_sequence_description(data, 1000, major=2))
    with pytest.raises(CorruptFileError):
        decode_sequence_description(b"", 1000, major=2)


def test_damage_to_a_description_ends_in_our_own_error() -> None:
    assert times_kind(irregular()) == TIMES_LISTED
    regular = encode_sequence_description(clip(np.arange(9) / 24), major=2)
    for data in (irregular(), regular):
        assert assert_only_corrupt_file_errors(data, lambda each: decode_sequence_description(each, 1000, major=2)) > 50


def described(
    *, frames: int = 3, fps: float = 24.0, kind: int = TIMES_COUNTED, start: float = 0.0, rate: float = 24.0,
    listed: list[float] | None = None, vertices: tuple[int, ...] = (5,), name: bytes = b"mesh",
) -> bytes:  # fmt: skip
    """Section SEQN of any numbers."""
    writer = FieldWriter()
    writer.count(frames)
    writer.numbers("dB", fps, kind)
    if kind in (TIMES_COUNTED | AT_FRAME_RATE, TIMES_LISTED | AT_FRAME_RATE):
        writer.numbers("d", start)
    elif kind != TIMES_LISTED:
        writer.numbers("dd", start, rate)
    if listed is not None:
        writer.sized(compress(np.array(listed, "<f8").tobytes()))
    writer.count(len(vertices))
    for count in vertices:
        writer.count(count)
        writer.count(len(name))
        writer.numbers(f"{len(name)}s", name)
    return writer.to_bytes()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (described(frames=0), "0 frames"),
        (described(frames=101), "101 frames"),
        (described(frames=2**63 - 1), f"{2**63 - 1} frames"),
        (described(frames=2**63), "count of more than 63 bits"),
        (described(fps=0.0), "frame rate"),
        (described(fps=-24.0), "frame rate"),
        (described(fps=float("nan")), "not finite"),
        (described(fps=float("inf")), "not finite"),
        (described(kind=TIMES_LISTED | AT_FRAME_RATE), "unknown way"),
        (described(kind=8), "unknown way"),
        (described(kind=TIMES_COUNTED | AT_FRAME_RATE, start=1e300), "out of range"),
        (described(rate=0.0), "unknown way"),
        (described(rate=-1.0), "unknown way"),
        (described(start=float("inf")), "not finite"),
        (described(rate=5e-324), "out of range"),
        (described(rate=1e300), "do not increase"),
        (described(start=1e300), "out of range"),
        (described(kind=TIMES_LISTED, listed=[0, 1]), "too few times"),
        (described(kind=TIMES_LISTED, listed=[0, 1, 2, 3]), "declares 32 bytes"),
        (described(kind=TIMES_LISTED, listed=[0, 2, 1]), "do not increase"),
        (described(kind=TIMES_LISTED, listed=[0, 0, 1]), "do not increase"),
        (described(kind=TIMES_LISTED, listed=[0, np.nan, 1]), "do not increase"),
        (described(kind=TIMES_LISTED, listed=[-1e308, 0, 1e308]), "out of range"),
        (described(vertices=()), "0 vertices"),
        (described(vertices=(0, 0)), "0 vertices"),
        (described(vertices=(2**63 - 1, 2**63 - 1)), "vertices"),
        (described(vertices=(MAX_INDEX, 1)), f"{MAX_INDEX + 1} vertices"),
        (described(name=b"\xff\xfe"), "not UTF-8"),
    ],
)
def test_numbers_out_of_range_are_named(data: bytes, message: str) -> None:
    with pytest.raises(CorruptFileError, match=message):
        decode_sequence_description(data, 100, major=2)


def assert_attributes_come_back(objects: list[MeshObject]) -> bytes:
    data = encode_attributes(objects)
    assert data == encode_attributes(objects)
    bare = [replace(item, attributes=()) for item in objects]
    found = decode_attributes(data, bare, PLENTY)
    assert [item.name for item in found] == [item.name for item in objects]
    for mine, other in zip(found, objects, strict=True):
        assert mine.connectivity is other.connectivity
        assert len(mine.attributes) == len(other.attributes)
        for attribute, expected in zip(mine.attributes, other.attributes, strict=True):
            assert (attribute.name, attribute.domain, attribute.labels) == (
                expected.name,
                expected.domain,
                expected.labels,
            )
            assert attribute.values.dtype == expected.values.dtype
            assert attribute.values.shape == expected.values.shape
            assert attribute.values.tobytes() == expected.values.tobytes()
            assert (attribute.indices is None) == (expected.indices is None)
            if attribute.indices is not None and expected.indices is not None:
                assert attribute.indices.dtype == np.int32
                assert np.array_equal(attribute.indices, expected.indices)
    return data


def test_every_domain_and_type_of_attribute_comes_back() -> None:
    assert_attributes_come_back(list(rich_sequence().objects))


def test_objects_without_attributes_take_no_bytes() -> None:
    objects = [MeshObject("a", Connectivity(3)), MeshObject("b", Connectivity(1))]
    assert encode_attributes(objects) == b""
    assert decode_attributes(b"", objects, 0) == objects


@st.composite
def attributes(draw: st.DrawFn) -> Attribute:
    """Any attribute of an object of three vertices, two faces and seven corners."""
    domain, rows = draw(st.sampled_from([("vertex", 3), ("face", 2), ("corner", 7), ("object", 4)]))
    indexed = draw(st.booleans())
    own_rows = draw(st.integers(0, 5)) if indexed else rows
    shape = (own_rows,) if draw(st.booleans()) else (own_rows, draw(st.integers(0, 3)))
    values = draw(arrays.arrays(np.dtype(draw(st.sampled_from(VALUE_TYPES))), shape))
    index = st.integers(-1, own_rows - 1)
    indices = draw(arrays.arrays(np.int32, rows, elements=index)) if indexed else None
    labels = tuple(draw(st.lists(st.text(max_size=4), max_size=3)))
    return Attribute(draw(st.text(st.characters(codec="utf-8"), max_size=5)), domain, values, indices, labels)


@settings(max_examples=80, deadline=None)
@given(st.lists(attributes(), max_size=3))
def test_any_attributes_come_back(drawn: list[Attribute]) -> None:
    mesh = connectivity_of(3, [[0, 1, 2], [2, 1, 0, 0]])
    assert_attributes_come_back([MeshObject("mesh", mesh, tuple(drawn)), MeshObject("rest", mesh)])


def test_values_that_do_not_lie_in_memory_in_order_come_back() -> None:
    values = np.arange(24, dtype=np.float32).reshape(4, 6)[::-1, ::2].astype(">f4")
    (found,) = decode_attributes(
        encode_attributes([MeshObject("m", Connectivity(4), (Attribute("odd", "vertex", values),))]),
        [MeshObject("m", Connectivity(4))],
        PLENTY,
    )
    assert found.attributes[0].values.dtype == np.float32
    assert np.array_equal(found.attributes[0].values, values)


@pytest.mark.parametrize(
    "values", [np.zeros(3, np.complex64), np.zeros(3, np.float16), np.zeros(3, bool), np.zeros((3, 1, 1), np.float32)]
)
def test_values_of_a_type_that_the_file_does_not_know_are_named(values: NDArray[Any]) -> None:
    mesh = MeshObject("mesh", Connectivity(3), (Attribute("odd", "vertex", values),))
    with pytest.raises(InputError, match="attribute 'odd' of object 'mesh'"):
        encode_attributes([mesh])


def bare_objects() -> list[MeshObject]:
    return [replace(item, attributes=()) for item in rich_sequence().objects]


def test_attributes_that_are_cut_or_too_long_are_refused() -> None:
    data = encode_attributes(rich_sequence().objects)
    assert_cuts_are_refused(data, lambda each: decode_attributes(each, bare_objects(), PLENTY))


def test_damage_to_attributes_ends_in_our_own_error() -> None:
    data = encode_attributes(rich_sequence().objects)
    assert assert_only_corrupt_file_errors(data, lambda each: decode_attributes(each, bare_objects(), PLENTY)) > 300


def test_attributes_of_other_objects_are_refused() -> None:
    data = encode_attributes(rich_sequence().objects)
    for objects in (bare_objects()[::-1], bare_objects()[:1], bare_objects() * 2):
        with pytest.raises(CorruptFileError):
            decode_attributes(data, objects, PLENTY)


def coded(
    *, domain: int = 0, kind: int = 0, shape: tuple[int, ...] = (3,), raw: bytes = bytes(12),
    indices: list[int] | None = None, marked: int | None = None, labels: bytes = b"",
) -> bytes:  # fmt: skip
    """Section ATTR of one object with one attribute of any numbers."""
    writer = FieldWriter()
    writer.numbers("I", 1)
    writer.text("odd")
    writer.numbers("BBB", domain, kind, len(shape))
    writer.numbers("Q" * len(shape), *shape)
    writer.sized(compress(raw))
    writer.numbers("Q", marked if marked is not None else 0 if indices is None else len(indices) + 1)
    if indices is not None:
        writer.sized(pack_integers(np.array(indices, np.int64)))
    writer.sized(compress(labels))
    return writer.to_bytes()


def decode_coded(data: bytes, room: int = PLENTY) -> Attribute:
    (found,) = decode_attributes(data, [MeshObject("mesh", Connectivity(3))], room)
    return found.attributes[0]


def test_the_sections_built_here_are_sound_where_their_numbers_are() -> None:
    found = decode_coded(coded(indices=[2, -3, 1], labels=b'["a"]'))
    assert found.indices is not None
    assert found.indices.tolist() == [2, -1, 0]
    assert found.labels == ("a",)
    assert found.values.tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (coded(domain=4), "unknown kind"),
        (coded(kind=5), "unknown kind"),
        (coded(shape=()), "unknown kind"),
        (coded(shape=(3, 1, 1)), "unknown kind"),
        (coded(raw=bytes(11)), "wrong size"),
        (coded(raw=bytes(13)), "declares 13 bytes"),
        (coded(raw=b""), "wrong size"),
        (coded(shape=(4,), raw=bytes(16)), "has 4 rows, but there are 3"),
        (coded(shape=(0, 2**63), raw=b""), "rows or columns"),
        (coded(shape=(2**63, 0), raw=b""), "rows or columns"),
        (coded(indices=[0, 1]), "has 2 rows, but there are 3"),
        (coded(indices=[0, 1, 2]), "index out of range"),
        (coded(indices=[-2, 2, 0]), "index out of range"),
        (coded(indices=[0, 2**63 - 1, 0]), "index out of range"),
        (coded(indices=[0, 1, 1], marked=9), "stream of 8 integers|exactly 8"),
        (coded(labels=b'["a"'), "not JSON"),
        (coded(labels=b"\xff\xfe\xff"), "not JSON"),
        (coded(labels=b'{"a": 1}'), "labels that are not texts"),
        (coded(labels=b"[1]"), "labels that are not texts"),
        (coded(labels=b"[" * 100_000), "not JSON"),
    ],
)
def test_attributes_out_of_range_are_named(data: bytes, message: str) -> None:
    with pytest.raises(CorruptFileError, match=message):
        decode_coded(data)


@pytest.mark.parametrize(
    ("data", "needed"),
    [
        (coded(), 12 * BYTES_PER_VALUE_BYTE),
        (coded(indices=[0, 0, 0]), 12 * BYTES_PER_VALUE_BYTE + 3 * BYTES_PER_INDEX),
        (coded(labels=b'["a"]'), 12 * BYTES_PER_VALUE_BYTE + 5 * BYTES_PER_JSON_BYTE),
    ],
    ids=["values", "indices", "labels"],
)
def test_attributes_that_need_more_memory_than_there_is_are_refused(data: bytes, needed: int) -> None:
    assert decode_coded(data, needed).name == "odd"
    with pytest.raises(LimitError, match="memory limit"):
        decode_coded(data, needed - 1)


def test_sizes_beyond_any_memory_are_refused_before_memory_is_taken() -> None:
    for data in (coded(shape=(MAX_INDEX, MAX_INDEX)), coded(indices=[], marked=2**60)):
        with pytest.raises(LimitError):
            decode_coded(data)


REMARKS = st.dictionaries(
    st.text(max_size=5),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
        max_leaves=5,
    ),
    max_size=4,
)


@settings(max_examples=80, deadline=None)
@given(REMARKS)
def test_remarks_come_back(remarks: dict[str, Any]) -> None:
    data = encode_remarks(remarks)
    assert decode_remarks(data) == remarks
    assert encode_remarks(dict(reversed(remarks.items()))) == data  # the order in memory does not show


def test_no_remarks_are_an_empty_object() -> None:
    assert decode_remarks(b"") == {}


@pytest.mark.parametrize("text", [b"[]", b"3", b"null", b"{", b"{'a': 1}", b"\x80", b"[" * 200_000, b'{"a": ' * 9999])
def test_remarks_that_are_no_object_are_refused(text: bytes) -> None:
    with pytest.raises(CorruptFileError, match="section META"):
        decode_remarks(compress(text))


def test_remarks_longer_than_anyone_writes_are_refused() -> None:
    with pytest.raises(CorruptFileError, match="declares"):
        decode_remarks(compress(json.dumps("a" * MAX_JSON_BYTES).encode()))


def test_damage_to_remarks_ends_in_our_own_error() -> None:
    data = encode_remarks({"metadata": {"up_axis": "Y"}, "settings": {"tolerance": 1e-3, "alpha": None}})
    assert_cuts_are_refused(data, decode_remarks)
    assert assert_only_corrupt_file_errors(data, decode_remarks) > 50


def test_a_name_that_no_text_encoding_holds_is_refused_by_name() -> None:
    broken = MeshObject("part\ud800", Connectivity(1))
    with pytest.raises(InputError, match="rename"):
        encode_sequence_description(ArraySequence(np.zeros((1, 1, 3)), objects=[broken]), major=2)
