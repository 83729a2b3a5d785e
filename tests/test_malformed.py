"""Hostile and damaged files: nothing but CorruptFileError (or its LimitError), in bounded time and memory."""

from __future__ import annotations

import struct
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import timedelta
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mesh_cases import connectivity_of, grid
from test_round_trip import noise, wave

from pdecodec import (
    ArraySequence,
    Attribute,
    CorruptFileError,
    DecodeLimits,
    EncodeSettings,
    LimitError,
    MeshObject,
    encode,
    open_animation,
)
from pdecodec.container import ContainerReader
from spec.sealing import (
    ENTRY_1,
    HEADER,
    Part,
    compressed,
    content,
    integers,
    seal,
    sized,
    split_integers,
    streams,
    take_apart,
    unpacked,
    varints,
    with_chunk,
    with_section,
    with_stream,
    zeros,
)

MEMORY = 2**25
"""Limit that every file here is opened with."""

Decode = Callable[[bytes], str]


@dataclass(frozen=True)
class SoundFile:
    """A small file that nothing is wrong with."""

    data: bytes = field(repr=False)

    @property
    def parts(self) -> list[Part]:
        return take_apart(self.data)


@pytest.fixture(scope="module")
def decode(tmp_path_factory: pytest.TempPathFactory) -> Decode:
    """Decode all there is in these bytes; says "sound" or the name of the error."""
    path = tmp_path_factory.mktemp("malformed") / "a.pdeanim"

    def everything() -> None:
        with open_animation(path, limits=DecodeLimits(max_memory=MEMORY)) as animation:
            animation.info()
            animation.verify()
            first, last = float(animation.times[0]), float(animation.times[-1])
            animation.sample([first, first + 1e-3, (first + last) / 2, last])
            animation.velocities((first + last) / 2)

    def outcome(data: bytes) -> str:
        path.write_bytes(data)
        try:
            everything()
        except CorruptFileError as error:
            said = str(error)
            sound = said.startswith(str(path)) and "\n" not in said
            return type(error).__name__ if sound else f"a message that is not one line about the file: {said}"
        return "sound"

    return outcome


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> SoundFile:
    """One segment, every section, moving frames, corrections of both kinds, attributes with index and labels."""
    points = wave(4, rows=3, columns=4) + 0.1 * noise(4, 12)
    points[2, 3] += np.float32(1e20)
    body = grid(3, 3)
    uv = Attribute("uv", "corner", np.eye(4, 2, dtype=np.float32), np.tile(np.arange(4, dtype=np.int32), 4))
    group = Attribute("group", "face", np.arange(4, dtype=np.int32) % 2, labels=("arm", "Bein ü"))
    objects = [MeshObject("body", body, (uv, group)), MeshObject("points", connectivity_of(3))]
    path = tmp_path_factory.mktemp("sound") / "a.pdeanim"
    options = EncodeSettings(profile="segments", alignment="rotation", segment_frames=4, effort=1)
    encode(ArraySequence(points, objects=objects, metadata={"unit": "m"}), path, options)
    return SoundFile(path.read_bytes())


def test_the_file_that_is_damaged_here_is_sound_and_has_every_section(sound: SoundFile, decode: Decode) -> None:
    assert decode(sound.data) == "sound"
    parts = sound.parts
    assert [part.kind for part in parts] == ["META", "SEQN", "CONN", "REST", "MODL", "SEGM", "COEF", "CORR", "ATTR"]
    assert all(part.content for part in parts)
    assert len(content(parts, "SEGM")) == 24
    assert seal(parts) == sound.data
    for part in parts:
        assert seal(with_section(parts, part.kind, part.content)) == sound.data
    assert [len(streams(part.content)) for part in parts] == [0, 0, 1, 3, 1, 0, 2, 7, 4]


def test_every_truncation_is_refused(sound: SoundFile, decode: Decode) -> None:
    for size in range(len(sound.data)):
        assert decode(sound.data[:size]) == "CorruptFileError"


def test_every_byte_of_header_and_table_is_guarded(sound: SoundFile, decode: Decode) -> None:
    data = sound.data
    for at in range(HEADER.size + 9 * ENTRY_1.size):
        for mask in (0x01, 0x80, 0xFF):
            assert decode(data[:at] + bytes([data[at] ^ mask]) + data[at + 1 :]) == "CorruptFileError", at


def test_every_byte_of_every_section_is_guarded(sound: SoundFile, decode: Decode) -> None:
    data = sound.data
    for at in range(HEADER.size + 9 * ENTRY_1.size, len(data)):
        changed = data[:at] + bytes([data[at] ^ 0x10]) + data[at + 1 :]
        with pytest.raises(CorruptFileError, match="is damaged"):
            ContainerReader(BytesIO(changed), "a").verify()
        if at % 5 == 0:
            assert decode(changed) == "CorruptFileError", at


def test_behind_the_checksums_every_byte_changed_ends_in_our_own_error_or_decodes(
    sound: SoundFile, decode: Decode
) -> None:
    parts = sound.parts
    outcomes = set()
    for part in parts:
        data = part.content
        for at in range(len(data)):
            changed = data[:at] + bytes([data[at] ^ (0x81 >> at % 8)]) + data[at + 1 :]
            outcomes.add(decode(seal(with_section(parts, part.kind, changed))))
    assert outcomes in ({"sound", "CorruptFileError"}, {"sound", "CorruptFileError", "LimitError"})


def test_behind_the_checksums_sections_cut_short_or_too_long_are_refused(sound: SoundFile, decode: Decode) -> None:
    parts = sound.parts
    for part in parts:
        for size in range(0, len(part.content), 1 + len(part.content) // 20):
            # An empty META or ATTR says that there is nothing to say.
            expected = "sound" if size == 0 and part.kind in ("META", "ATTR") else "CorruptFileError"
            assert decode(seal(with_section(parts, part.kind, part.content[:size]))) == expected, (part.kind, size)
        assert decode(seal(with_section(parts, part.kind, part.content + b"\0"))) == "CorruptFileError"
    for kind in ("COEF", "CORR"):
        chunk = content(parts, kind)
        for size in range(1, len(chunk), 1 + len(chunk) // 20):
            assert decode(seal(with_chunk(parts, kind, chunk[:size]))) == "CorruptFileError"
        assert decode(seal(with_chunk(parts, kind, chunk + b"\0"))) == "CorruptFileError"
        assert decode(seal(with_chunk(parts, kind, b""))) == "sound"


def test_every_section_but_remarks_and_attributes_is_needed(sound: SoundFile, decode: Decode) -> None:
    for left_out in sound.parts:
        outcome = decode(seal([part for part in sound.parts if part != left_out]))
        assert outcome == ("sound" if left_out.kind in ("META", "ATTR") else "CorruptFileError")


def test_sections_in_another_order_decode(sound: SoundFile, decode: Decode) -> None:
    assert decode(seal(sound.parts[::-1])) == "sound"


EDGES = [0, 1, -1, 2, 35, 127, 128, 2**15, 2**31 - 1, 2**31, -(2**31), 2**40, 2**40 + 1, 2**62, 2**63 - 1, -(2**63)]
REALS = [0.0, -0.0, -1.0, 1e-320, 1e-300, 12.0, 12.001, 1e30, 2.0**160, 2.0**161, 1e308, np.inf, -np.inf, np.nan]


@st.composite
def damages(draw: st.DrawFn) -> Callable[[list[Part]], bytes]:
    """A way to change one section of a file, behind its checksums."""
    kind = draw(st.sampled_from(["META", "SEQN", "CONN", "REST", "MODL", "SEGM", "COEF", "CORR", "ATTR"]))
    place, stream = draw(st.floats(0, 0.999)), draw(st.floats(0, 0.999))
    new = draw(
        st.binary(min_size=1, max_size=8)
        | st.sampled_from(EDGES).map(lambda value: (value % 2**64).to_bytes(8, "little"))
        | st.sampled_from(REALS).map(lambda value: struct.pack("<d", value))
        | st.sampled_from([0.0, -1.0, 12.1, np.nan, np.inf]).map(lambda value: struct.pack("<f", value))
    )
    number = draw(st.sampled_from(EDGES) | st.integers(-(2**63), 2**63 - 1))
    inside = draw(st.booleans())

    def apply(parts: list[Part]) -> bytes:
        data = content(parts, kind)
        found = streams(data)
        if inside and found:
            chosen = found[int(stream * len(found))]
            values = split_integers(unpacked(data, chosen))
            values[int(place * len(values))] = varints(number)
            data = with_stream(data, chosen, b"".join(values))
        else:
            at = int(place * len(data))
            data = data[:at] + new + data[at + len(new) :]
        change = with_chunk if kind in ("COEF", "CORR") else with_section
        return seal(change(parts, kind, data))

    return apply


@settings(
    max_examples=400,
    deadline=timedelta(seconds=5),
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(st.lists(damages(), min_size=1, max_size=2))
def test_behind_the_checksums_any_damage_ends_in_our_own_error_or_decodes(
    sound: SoundFile, decode: Decode, several: list[Callable[[list[Part]], bytes]]
) -> None:
    data = sound.data
    for damage in several:
        data = damage(take_apart(data))
    assert decode(data) in ("sound", "CorruptFileError", "LimitError")


def points_only(vertices: int) -> list[Part]:
    """The sections of a small file, changed to declare this many points at the origin and nothing else."""
    frames = 64
    sequence = struct.pack("<QdBddI", frames, 24.0, 1, 0.0, 24.0, 1) + struct.pack("<Q", vertices) + sized(b"m")
    nothing = struct.pack("<QQI", 0, 0, 0) + sized(b"") + sized(b"")
    coordinates = sized(compressed(bytes(vertices)))
    rest = struct.pack("<ddddB", 1.0, 0.0, 0.0, 0.0, 1) + 3 * coordinates
    model = struct.pack("<BdddQ", 0, 0.0, 1.0, 1.0, 8) + integers(15)
    table = struct.pack("<IfhHIII", frames, 0.0, 0, 0, 0, 0, 0)
    kinds = {
        "SEQN": sequence,
        "CONN": nothing * 2,
        "REST": rest,
        "MODL": model,
        "SEGM": table,
        "COEF": b"",
        "CORR": b"",
    }
    return [Part(kind, data) for kind, data in kinds.items()]


def hostile_sizes() -> Iterator[tuple[str, bytes, str]]:
    """Files of a few kilobytes that ask for gigabytes: what for, the bytes, the error."""
    few = points_only(100)
    sequence = content(few, "SEQN")
    many = 2**30
    yield (
        "vertices",
        seal(with_section(few, "SEQN", sequence[:37] + struct.pack("<Q", many) + sized(b"m"))),
        "LimitError",
    )
    yield (
        "objects",
        seal(with_section(few, "SEQN", sequence[:33] + b"\xff\xff\xff\xff" + sequence[37:])),
        "CorruptFileError",
    )
    yield "frames", seal(with_section(few, "SEQN", struct.pack("<Q", 2**62) + sequence[8:])), "CorruptFileError"
    nothing = content(few, "CONN")[36:]
    for count, uniform in ((many, 0), (many // 4, 4), (1, many)):
        faces = struct.pack("<QQI", count, many, uniform) + (b"" if uniform else sized(zeros(many, 20)))
        yield "corners", seal(with_section(few, "CONN", faces + sized(zeros(many, 20)) + nothing)), "LimitError"
    yield (
        "a long stream",
        seal(with_section(few, "MODL", content(few, "MODL")[:33] + sized(zeros(2**33, 100)))),
        ("CorruptFileError"),
    )
    lie = sized(zeros(900, 5000))  # declares what can be, and unpacks to 600 MB
    yield "a stream that lies", seal(with_section(few, "REST", content(few, "REST")[:33] + 3 * lie)), "CorruptFileError"
    yield "remarks", seal([Part("META", zeros(2**33, 5000), 0), *few]), "CorruptFileError"
    labels = compressed(b"[" + b'"",' * 2_000_000 + b'""]')
    attribute = sized(b"a") + struct.pack("<BBBQ", 3, 3, 1, 1) + sized(compressed(b"\0")) + struct.pack("<Q", 0)
    everything = struct.pack("<I", 50) + 50 * (attribute + sized(labels))
    yield "labels", seal([*few, Part("ATTR", everything)]), "LimitError"
    for shape in ((2**31 - 1, 2**31 - 1), (2**63, 2**63), (0, 2**64 - 1)):
        header = struct.pack("<I", 1) + sized(b"a") + struct.pack("<BBBQQ", 3, 4, 2, *shape)
        values = header + sized(zeros(2**40, 10)) + struct.pack("<Q", 0) + sized(b"")
        expected = "CorruptFileError" if max(shape) >= 2**31 else "LimitError"
        yield f"values {shape}", seal([*few, Part("ATTR", values)]), expected
    header = struct.pack("<I", 1) + sized(b"a") + struct.pack("<BBBQ", 0, 3, 1, 1) + sized(compressed(b"\0"))
    indices = header + struct.pack("<Q", 2**62) + sized(zeros(2**40, 10)) + sized(b"")
    yield "indices", seal([*few, Part("ATTR", indices)]), "LimitError"
    crowd = points_only(20_000)
    every = [20_000, 0] * 64
    chunk = integers(*every) + 4 * sized(compressed(bytes(64 * 20_000))) + 2 * sized(b"")
    yield "corrections", seal(with_chunk(crowd, "CORR", chunk)), "LimitError"
    counts = integers(2**62, 2**62, *([0] * 126))
    chunk = counts + sized(zeros(2**60, 10)) * 4 + 2 * sized(b"")
    yield "corrections whose number wraps round", seal(with_chunk(few, "CORR", chunk)), "CorruptFileError"


HOSTILE = list(hostile_sizes())


@pytest.mark.parametrize(("data", "expected"), [case[1:] for case in HOSTILE], ids=[case[0] for case in HOSTILE])
def test_hostile_sizes_are_refused_before_memory_is_taken(data: bytes, expected: str, decode: Decode) -> None:
    assert len(data) < 1_000_000
    tracemalloc.start()
    try:
        assert decode(data) == expected
        assert tracemalloc.get_traced_memory()[1] < 2 * MEMORY
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("vertices", [1, 100, 20_000])
def test_the_files_that_hostile_sizes_are_built_on_are_sound(vertices: int, decode: Decode) -> None:
    parts = points_only(vertices)
    if vertices < 8:  # a point has one function, not eight
        model = struct.pack("<BdddQ", 0, 0.0, 1.0, 1.0, vertices) + integers(15)
        parts = with_section(parts, "MODL", model)
    tracemalloc.start()
    try:
        assert decode(seal(parts)) == "sound"
        assert tracemalloc.get_traced_memory()[1] < 2 * MEMORY
    finally:
        tracemalloc.stop()


def test_a_limit_error_says_how_to_go_on(tmp_path: Path) -> None:
    path = tmp_path / "a.pdeanim"
    path.write_bytes(seal(points_only(50_000)))
    with pytest.raises(LimitError, match="raise it if you trust the file"):
        open_animation(path, limits=DecodeLimits(max_memory=2**20))
    with open_animation(path) as animation:
        assert animation.vertex_count == 50_000
