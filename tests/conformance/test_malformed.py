"""Hostile and damaged files: nothing but CorruptFileError (or its LimitError), in bounded time and memory."""

from __future__ import annotations

import os
import resource
import struct
import sys
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import timedelta
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pdecodec import (
    Animation,
    ArraySequence,
    Connectivity,
    CorruptFileError,
    DecodeLimits,
    EncodeSettings,
    MeshObject,
    encode,
    open_animation,
)
from pdecodec.codec.sections.space_basis import build_space_basis
from spec.decoder.animation import decode
from spec.decoder.fields import CorruptFileError as PlainCorruptFileError
from spec.decoder.groups import SHAPES, TRAJECTORIES
from spec.sealing import (
    CHUNKS,
    Part,
    Row,
    content,
    count,
    counted,
    numbers,
    run_of,
    scripted,
    seal,
    sequence,
    table_end,
    take_apart,
    take_rows,
    take_runs,
    text,
    with_first_group,
    with_runs,
    with_section,
    zeros,
)
from spec.vector_files import accepted_vectors

RUNS = ("runs", "runs_in_closed_form")
"""Vectors whose runs are damaged."""

VECTORS = accepted_vectors()
DAMAGED = ("groups_of_shapes", "raw_vertices", "welded", "polygons_attributes", "several_objects", "many_pieces")
"""Vectors that are damaged although checksums are valid: together they have every section, and both kinds of
corrections.
"""

MEMORY = 2**25
"""Limit that every file here is opened with."""

MAX_MEMORY = 2**32
"""Address space that a test may allocate; beyond it a MemoryError is raised, before the machine runs out of memory."""

SOUND, CORRUPT, LIMIT = "sound", "CorruptFileError", "LimitError"


@pytest.fixture(autouse=True)
def _bounded_memory() -> Iterator[None]:
    if sys.platform != "linux":
        yield
        return
    taken = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (taken + MAX_MEMORY, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


def outcome(data: bytes) -> str:
    """Return "sound" if everything in these bytes decodes, or the name of the error; any error that is not ours
    fails the test.
    """
    try:
        with open_animation(data, limits=DecodeLimits(max_memory=MEMORY)) as animation:
            animation.verify()
            animation.info()
            for run in animation.runs:
                assert isinstance(run, Animation)
                _ = run.objects
                first, last = float(run.times[0]), float(run.times[-1])
                run.sample([first, first + 1e-3, (first + last) / 2, last])
                run.velocities((first + last) / 2)
            assert len(animation.positions(first)) == run.vertex_count
    except CorruptFileError as error:
        return type(error).__name__ if "\n" not in str(error) else f"more than one line: {error}"
    return SOUND


def is_sound_elsewhere(data: bytes) -> bool:
    """Return whether the plain decoder can read these bytes."""
    try:
        decode(data)
    except PlainCorruptFileError:
        return False
    return True


def test_the_vectors_that_are_damaged_here_have_every_section() -> None:
    kinds = [part.kind for name in DAMAGED for part in take_apart(VECTORS[name]) if part.content]
    assert set(kinds) == {"META", "SEQN", "CONN", "ORDR", "REST", "MODL", "GRUP", *CHUNKS, "ATTR"}
    for name in DAMAGED:
        parts = take_apart(VECTORS[name])
        assert outcome(VECTORS[name]) == SOUND
        for part in parts:
            assert seal(with_section(parts, part.kind, part.content)) == VECTORS[name]


@pytest.mark.parametrize("name", VECTORS)
def test_every_truncation_and_every_byte_more_is_refused(name: str) -> None:
    data = VECTORS[name]
    for size in range(len(data)):
        assert outcome(data[:size]) == CORRUPT, size
    assert outcome(data + b"\0") == CORRUPT


@pytest.mark.parametrize("name", VECTORS)
def test_every_byte_is_guarded_by_a_checksum(name: str) -> None:
    data = VECTORS[name]
    table = table_end(take_apart(data))
    for at in range(len(data)):
        for mask in (0x01, 0x80, 0xFF) if at < table else (0x10 << at % 4,):
            assert outcome(data[:at] + bytes([data[at] ^ mask]) + data[at + 1 :]) == CORRUPT, at


@pytest.mark.parametrize("name", DAMAGED)
def test_behind_the_checksums_every_byte_changed_ends_in_our_own_error_or_decodes(name: str) -> None:
    parts = take_apart(VECTORS[name])
    found = set()
    for part in parts:
        data = part.content
        for at in range(len(data)):
            changed = data[:at] + bytes([data[at] ^ (0x81 >> at % 8)]) + data[at + 1 :]
            found.add(outcome(seal(with_section(parts, part.kind, changed))))
    assert {SOUND, CORRUPT} <= found <= {SOUND, CORRUPT, LIMIT}


@pytest.mark.parametrize("name", DAMAGED)
def test_sections_cut_short_too_long_or_missing_are_refused(name: str) -> None:
    parts = take_apart(VECTORS[name])
    for part in parts:
        if part.kind in ("SEQN", "CONN", "ORDR"):  # different names, faces and orders are valid too
            continue
        is_optional = part.kind in ("META", "ATTR")
        for size in range(0, len(part.content), 1 + len(part.content) // 12):
            # META and ATTR may be empty. A truncated stream is seldom valid.
            cut = seal(with_section(parts, part.kind, part.content[:size]))
            is_sound = (size == 0 and is_optional) or (part.kind == "REST" and is_sound_elsewhere(cut))
            assert outcome(cut) == (SOUND if is_sound else CORRUPT), (part.kind, size)
        assert outcome(seal(with_section(parts, part.kind, part.content + b"\0"))) == CORRUPT, part.kind
        others = [other for other in parts if other != part]
        assert outcome(seal(others)) == (SOUND if is_optional else CORRUPT), part.kind


def in_run(parts: list[Part], number: int, kind: str, new: bytes) -> bytes:
    """Return a file of runs with another section in one of them, and valid checksums of groups."""
    runs = take_runs(parts)
    sections = {name: section or b"" for name, section in runs[number].sections.items()}
    if kind == "NAME":
        sections["NAME"] = new
    else:
        own = with_section([Part(name, section) for name, section in sections.items()], kind, new)
        sections |= {part.kind: part.content for part in own}
    runs[number] = replace(runs[number], sections=dict(sections))
    return seal(with_runs(parts, runs))


@pytest.mark.parametrize("name", RUNS)
def test_behind_the_checksums_every_byte_of_runs_changed_ends_in_our_own_error_or_decodes(name: str) -> None:
    parts = take_apart(VECTORS[name])
    found = set()
    for kind in ("SEQN", "RUNS", "RDAT"):
        data = content(parts, kind)
        for at in range(len(data)):
            mask = (0x81 >> at % 8, 0x80, 0xFF)[at % 3]
            changed = data[:at] + bytes([data[at] ^ mask]) + data[at + 1 :]
            whole = [replace(part, content=changed) if part.kind == kind else part for part in parts]
            found.add(outcome(seal(whole)))
    for number, run in enumerate(take_runs(parts)):
        for kind, section in run.sections.items():
            for at in range(len(section or b"")):
                changed = section[:at] + bytes([section[at] ^ (0x81 >> at % 8)]) + section[at + 1 :]
                found.add(outcome(in_run(parts, number, kind, changed)))
    assert {SOUND, CORRUPT} <= found <= {SOUND, CORRUPT, LIMIT}


REALS = (0.0, -0.0, -1.0, 5e-324, 1e-300, 1e30, 2.0**160, 2.0**161, 1e308, np.inf, -np.inf, np.nan)
WHOLES = (0, 1, 2, 127, 128, 4096, 4097, 2**16, 2**31 - 1, 2**31, 2**32 - 1)


@settings(
    max_examples=400,
    deadline=timedelta(seconds=60),
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(
    st.sampled_from(DAMAGED),
    st.lists(
        st.tuples(
            st.floats(0, 0.999),
            st.floats(0, 0.999),
            st.binary(min_size=1, max_size=8)
            | st.sampled_from(REALS).map(lambda value: struct.pack("<d", value))
            | st.sampled_from(WHOLES).map(lambda value: struct.pack("<I", value)),
        ),
        min_size=1,
        max_size=3,
    ),
)
def test_behind_the_checksums_any_damage_ends_in_our_own_error_or_decodes(
    name: str, damages: list[tuple[float, float, bytes]]
) -> None:
    parts = take_apart(VECTORS[name])
    for which, place, new in damages:
        part = parts[int(which * len(parts))]
        at = int(place * len(part.content))
        changed = part.content[:at] + new + part.content[at + len(new) :]
        parts = with_section(parts, part.kind, changed[: len(part.content)])
    assert outcome(seal(parts)) in (SOUND, CORRUPT, LIMIT)


@cache
def points_only(vertices: int, frames: int = 64) -> list[Part]:
    """Return the sections of a file that declares this many points and frames, all near the origin, and no faces."""
    places = np.arange(min(vertices, 20_000))[np.newaxis, :, np.newaxis]
    points = ArraySequence(1e-6 * places * [1.0, 0.0, 0.0])  # positions differ, so that no vertices are tied
    data = encode(points, settings=EncodeSettings(effort="fast", max_error=1.0)).data
    assert data is not None
    parts = [part for part in take_apart(data) if part.kind != "META"]
    (row,), _ = take_rows(content(parts, "GRUP"))
    parts = with_section(parts, "SEQN", b"\1" + count(frames) + content(parts, "SEQN")[2:])
    nothing = content(parts, "CONN")[1 + len(count(points.vertex_count)) :]
    parts = with_section(parts, "CONN", b"\1" + count(vertices) + nothing)
    return with_section(parts, "GRUP", replace(row, frames=frames).pack())


def hostile_sizes() -> Iterator[tuple[str, bytes, str]]:
    """Files of a few kilobytes that ask for gigabytes: the purpose, the bytes, the error."""
    few = points_only(100)
    yield "vertices", seal(points_only(2**30)), LIMIT
    yield "frames", seal(with_section(few, "SEQN", sequence(2**62, flags=28) + b"\0")), LIMIT
    yield "objects", seal(with_section(few, "CONN", count(2**31 - 1) + bytes(1000))), CORRUPT
    yield "runs", seal([Part("SEQN", count(2**62) + bytes([1] * 1000)), Part("RUNS", b""), Part("RDAT", b"")]), CORRUPT
    yield "runs of many frames", seal([Part("SEQN", b"\2" + 2 * count(2**62)), *few[1:]]), LIMIT
    for faces, size in ((2**28, 4), (1, 2**30)):
        head = numbers(faces, size)
        yield f"{faces} faces of {size}", seal(scripted(few, "CONN", head, head=b"\1\x64")), LIMIT
    yield "corners", seal(scripted(few, "CONN", numbers(2**20, 0, 2**30), head=b"\1\x64")), LIMIT
    yield "remarks", seal([Part("META", zeros(2**33, 5000), 0), *few]), CORRUPT
    yield "remarks that lie", seal([Part("META", zeros(900, 5000), 0), *few]), CORRUPT
    for name, number in (("residuals", 64 * 20_000), ("residuals beyond all", 2**42)):
        chunk = content(scripted(points_only(300), "CORR", counted(number + 1) + "0 0", group=True), "CORR")
        yield name, seal(with_first_group(points_only(20_000), "CORR", chunk)), LIMIT if number < 2**42 else CORRUPT
    for frames, functions in ((4096, 3 * 4096), (2**32 - 1, 1), (64, 2**32 - 1)):
        row = Row(frames, functions, TRAJECTORIES, struct.pack("<dd", 1.0, 1.0), (0, 0, 0))
        clip = with_section(points_only(20_000, frames), "GRUP", row.pack())
        yield f"{functions} of {frames} frames", seal(clip), CORRUPT if functions > 3 * frames else LIMIT
    most = 2**31 - 1
    for name, head, expected in (
        ("attributes", numbers(most), CORRUPT),
        ("labels", numbers(1) + text(b"a") + numbers(3, 2, 0, 0, 1, most), CORRUPT),
        ("elements", numbers(1) + text(b"a") + numbers(3, 2, 0, 0, most, 0), LIMIT),
        ("rows", numbers(1) + text(b"a") + numbers(0, 2, 0, 2, most, 0), LIMIT),
        ("columns", numbers(1) + text(b"a") + numbers(3, 5, most, 0, 1, 0), LIMIT),
        ("values", numbers(1) + text(b"a") + numbers(3, 9, most, 0, most, 0), LIMIT),
        ("a table", numbers(1) + text(b"a") + numbers(0, 1, 2, 0, 0) + numbers(1, most), LIMIT),
    ):
        yield name, seal(scripted([*few, Part("ATTR", b"")], "ATTR", head)), expected


def test_hostile_sizes_are_refused_before_memory_is_taken() -> None:
    for name, data, expected in hostile_sizes():
        assert len(data) < 1_000_000
        tracemalloc.start()
        try:
            assert outcome(data) == expected, name
            assert tracemalloc.get_traced_memory()[1] < 2 * MEMORY, name
        finally:
            tracemalloc.stop()


def many_frames(frames: int, each: int) -> bytes:
    """Return a file of one vertex with empty groups of `each` frames."""
    parts = points_only(1)
    (row,), _ = take_rows(content(parts, "GRUP"))
    parts = with_section(parts, "SEQN", b"\1" + count(frames) + content(parts, "SEQN")[2:])
    rows = [replace(row, frames=min(each, frames - first)) for first in range(0, frames, each)]
    return seal(with_section(parts, "GRUP", b"".join(row.pack() for row in rows)))


def many_objects(objects: int) -> bytes:
    """Return a file of one vertex with many objects, all but one of them empty."""
    items = [MeshObject("a", Connectivity(1)), *(MeshObject("b", Connectivity(0)) for _ in range(objects - 1))]
    return encode(ArraySequence(np.zeros((1, 1, 3)), objects=items), effort="fast").data or b""


def one_name(size: int) -> bytes:
    item = MeshObject("a" * size + "\U0001f600", Connectivity(1))  # makes Python take four bytes per character
    return encode(ArraySequence(np.zeros((1, 1, 3)), objects=[item]), effort="fast").data or b""


def many_runs(runs: int) -> bytes:
    """Return a file of one vertex with many identical runs of one frame."""
    parts = points_only(1, 1)
    first = run_of(parts, b"\x56", 1)
    row = replace(first, sections=dict.fromkeys(first.sections)).row()
    times = count(runs) + bytes([1]) * runs + sequence(1, flags=28)[2:]
    return seal([Part("SEQN", times), Part("RUNS", first.row() + row * (runs - 1)), Part("RDAT", first.data)])


def patches_of_one_point(vertices: int, groups: int, frames: int, functions: int, kind: int) -> bytes:
    """Return a file with one patch per vertex, and groups in which nothing moves."""
    item = MeshObject("a", Connectivity(vertices))
    basis = build_space_basis("patch", [item], np.zeros((vertices, 3), np.int64), points=1, functions=1)
    parts = points_only(vertices, groups * frames)
    model = bytes([0]) + count(1) + bytes([1, 0]) + struct.pack("<d", 1.0) + basis.layout
    row = Row(frames, functions, kind, struct.pack("<dd", 1.0, 1.0), (0, 0, 0)).pack()
    return seal(with_section(with_section(parts, "MODL", model), "GRUP", row * groups))


MANY: dict[str, tuple[Callable[[], bytes], str]] = {
    "patches of many groups": (lambda: patches_of_one_point(6_000, 1_000, 1, 1, TRAJECTORIES), SOUND),
    "more patches": (lambda: patches_of_one_point(16_000, 1, 1, 1, TRAJECTORIES), LIMIT),
    "patches and functions of time": (lambda: patches_of_one_point(500, 100, 64, 64, SHAPES), SOUND),
    "more functions of time": (lambda: patches_of_one_point(6_000, 1, 64, 64, SHAPES), LIMIT),
    "as many frames as can be": (lambda: many_frames(260_000, 4096), SOUND),
    "more frames": (lambda: many_frames(270_000, 4096), LIMIT),
    "as many groups as can be": (lambda: many_frames(19_000, 1), SOUND),
    "more groups": (lambda: many_frames(25_000, 1), LIMIT),
    "as many objects as can be": (lambda: many_objects(5_500), SOUND),
    "more objects": (lambda: many_objects(9_000), LIMIT),
    "as many runs as can be": (lambda: many_runs(3_000), SOUND),
    "more runs": (lambda: many_runs(60_000), LIMIT),
    "as long a name as can be": (lambda: one_name(5_000_000), SOUND),
    "a longer name": (lambda: one_name(6_000_000), LIMIT),
}


@pytest.mark.skipif(sys.platform != "linux", reason="only there a process says how much memory it took")
@pytest.mark.parametrize("name", MANY)
def test_large_declared_counts_stay_within_the_memory_limit(name: str) -> None:
    make, expected = MANY[name]
    data = make()
    read, write = os.pipe()
    if (child := os.fork()) == 0:
        # Reset the peak, so that it is measured from here on.
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
        before = resident("VmRSS")
        os.write(write, f"{outcome(data)} {resident('VmHWM') - before}".encode())
        os._exit(0)
    os.close(write)
    with os.fdopen(read) as answer:
        found, taken = answer.read().split()
    os.waitpid(child, 0)
    assert found == expected
    assert int(taken) < MEMORY


def resident(field: str) -> int:
    """Return the memory of the process [bytes]: at present (VmRSS) or its peak (VmHWM)."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return 1024 * int(status.split(f"{field}:")[1].split()[0])


@pytest.mark.parametrize("vertices", [1, 100, 20_000])
def test_the_files_that_hostile_sizes_are_built_on_are_sound(vertices: int) -> None:
    tracemalloc.start()
    try:
        assert outcome(seal(points_only(vertices))) == SOUND
        assert tracemalloc.get_traced_memory()[1] < 2 * MEMORY
    finally:
        tracemalloc.stop()
