"""The vectors of format version 2 that every decoder must refuse: one small file, damaged in one place each."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pdecodec import ArraySequence, MeshObject
from pdecodec.group_corrections import encode_group
from pdecodec.levelcoding import encode_levels
from pdecodec.restcoding import decode_rest
from pdecodec.spacebasis import MOST_FUNCTIONS, build_space_basis
from spec.accepted import connectivity, grid, noise, wave
from spec.accepted_2 import Choices, corrected, encoded
from spec.refused import Refused
from spec.sealing import (
    CHUNKS,
    GROUP,
    Part,
    content,
    count,
    counted,
    even_bits,
    group_chunks,
    seal,
    sized,
    table_end,
    take_apart,
    with_first_group,
    with_group_section,
)


class Base:
    """The file that is damaged: six vertices of two quads and two points, six frames in two groups of modes.

    Vertex 3 is a literal in frame 2, others are corrected in steps.
    """

    def __init__(self) -> None:
        points = wave(6, 2, 4) + 0.1 * noise(6, 8, 3)
        points[2, 3] += 1e20
        objects = [MeshObject("b", grid(2, 3)), MeshObject("p", connectivity(2))]
        data = encoded(ArraySequence(points, objects=objects), Choices(longest_group=3, settings={"tolerance": 0.02}))
        self.parts = [part for part in take_apart(data) if part.kind != "META"]
        rest = decode_rest(content(self.parts, "REST"), objects).levels
        self.basis = build_space_basis("patch", objects, rest, points=64, functions=MOST_FUNCTIONS)

    def section(self, kind: str, new: bytes) -> bytes:
        """The file with another section."""
        return seal(with_group_section(self.parts, kind, new), major=2)

    def overwritten(self, kind: str, at: int, new: bytes) -> bytes:
        """The file with some bytes of a section overwritten."""
        data = content(self.parts, kind)
        return self.section(kind, data[:at] + new + data[at + len(new) :])

    def chunk(self, kind: str, new: bytes) -> bytes:
        """The file with another chunk of the first group."""
        return seal(with_first_group(self.parts, kind, new), major=2)

    def first_chunk(self, kind: str) -> bytes:
        return group_chunks(self.parts, kind)[0]


def refused() -> Iterator[Refused]:
    """Every file, in the order of the specification."""
    base = Base()
    for damage in (_container, _sequence, _connectivity, _rest, _model, _groups, _chunks):
        yield from damage(base)
    for damage in (_coefficients, _modes, _corrections, _sizes):
        yield from damage(base)


def _real(value: float) -> bytes:
    return struct.pack("<d", value)


def _container(base: Base) -> Iterator[Refused]:
    parts, whole = base.parts, seal(base.parts, major=2)
    yield Refused("major_version_3", seal(parts, major=3), "a major version that is not known (2)")
    yield Refused("table_of_version_1", seal(parts), "the sections of version 2 in a file of version 1 (3)")
    yield Refused("table_of_65_rows", seal([Part(f"A{k:03}", b"", 0) for k in range(65)], major=2), "65 sections (2)")
    at = table_end(parts[:2], 2) + 5
    changed = whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :]
    yield Refused("row_checksum", changed, "CRC of the table (2)")
    yield Refused("row_cut", whole[: table_end(parts, 2) - 1], "ends inside its table (3)")
    yield Refused("last_section_cut", whole[:-1], "ends before its last section does (3)")
    yield Refused("last_section_checksum", whole[:-1] + bytes([whole[-1] ^ 1]), "CRC of section CORR (3)")
    segments = seal([*parts, Part("SEGM", b"")], major=2)
    yield Refused("section_of_version_1", segments, "section SEGM, which version 2 does not know (3)")
    for kind in ("GRUP", *CHUNKS):
        missing = [part for part in parts if part.kind != kind]
        yield Refused(f"without_{kind.lower()}", seal(missing, major=2), f"section {kind} is missing (3)")


def _sequence(base: Base) -> Iterator[Refused]:
    for name, at, new, reason in (
        ("frames_fewer_than_in_groups", 0, b"\x05", "5 frames where the groups have 6 (5)"),
        ("frames_more_than_in_groups", 0, b"\x07", "7 frames where the groups have 6 (5)"),
        ("rule_of_times_6", 9, b"\x06", "rule 6 of times (5)"),
        ("rule_of_times_8", 9, b"\x08", "rule 8 of times (5)"),
    ):
        yield Refused(name, base.overwritten("SEQN", at, new), reason)
    data = content(base.parts, "SEQN")
    # Rule and start, without the rate that the frame rate stands for.
    zero = data[:9] + b"\x03" + _real(0.0) + _real(0.0) + data[18:]
    yield Refused("period_of_rate_zero", base.section("SEQN", zero), "times by a period at rate 0 (5)")
    tiny = data[:9] + b"\x03" + _real(0.0) + _real(5e-324) + data[18:]
    yield Refused("period_infinite", base.section("SEQN", tiny), "a period that is not finite (5)")
    long_count = b"\xff" * 9 + data[1:]
    yield Refused("count_of_ten_bytes", base.section("SEQN", long_count), "a count of frames beyond 63 bits (4.1)")


def _connectivity(base: Base) -> Iterator[Refused]:
    longer = content(base.parts, "CONN") + b"\0"
    yield Refused("conn_followed_by_zero", base.section("CONN", longer), "a zero byte too many (19.5)")
    points = take_apart(encoded(ArraySequence(wave(3, 2, 3)), Choices()))
    yield Refused("order_of_nothing", seal([*points, Part("ORDR", b"\1")], major=2), "an order without a surface (29)")


def _rest(base: Base) -> Iterator[Refused]:
    rest = content(base.parts, "REST")
    for name, at, new, reason in (
        ("step_of_rest_zero", 0, _real(0.0), "a step of 0 (20)"),
        ("origin_beyond", 24, _real(-(2.0**161)), "an origin beyond 2^160 (20)"),
        ("predictor_0", 32, b"\x00", "predictor 0 (20)"),
        ("predictor_5", 32, b"\x05", "predictor 5 (20)"),
    ):
        yield Refused(name, base.overwritten("REST", at, new), reason)
    yield Refused("rest_header_cut", base.section("REST", rest[:32]), "no predictor (20)")
    yield Refused("rest_followed_by_zero", base.section("REST", rest + b"\0"), "a zero byte too many (19.5)")
    yield Refused("rest_followed_by_byte", base.section("REST", rest + b"\1"), "a byte too many (19.5)")
    yield Refused("rest_without_end", base.section("REST", rest[:-8]), "8 bytes too few (19.5)")
    welded = rest[:32] + b"\4" + even_bits("1" + counted(1))
    yield Refused("weld_before_the_first", base.section("REST", welded), "the first vertex on a point before it (20.3)")
    # Of the predictors along curves: streams of integers, as in version 1.
    along = rest[:32] + b"\1" + 3 * sized(b"")
    yield Refused("rest_along_curves_empty", base.section("REST", along), "no levels along curves (8.1)")


def _model(base: Base) -> Iterator[Refused]:
    columns = content(base.parts, "MODL")[13:21]
    more = struct.pack("<Q", struct.unpack("<Q", columns)[0] + 1)
    for name, at, new, reason in (
        ("space_basis_2", 0, b"\x02", "space basis 2 (21.1)"),
        ("patches_of_no_points", 1, bytes(2), "patches of 0 points (21.1)"),
        ("patches_of_257_points", 1, struct.pack("<H", 257), "patches of 257 points (21.1)"),
        ("patches_of_no_functions", 3, bytes(2), "patches of 0 functions (21.1)"),
        ("patches_of_129_functions", 3, struct.pack("<H", 129), "patches of 129 functions (21.1)"),
        ("correction_step_zero", 5, _real(0.0), "a correction step of 0 (21.1)"),
        ("correction_step_beyond", 5, _real(2.0**161), "a correction step beyond 2^160 (21.1)"),
        ("one_column_more", 13, more, "a column more than the patches have (21.1)"),
    ):
        yield Refused(name, base.overwritten("MODL", at, new), reason)
    model = content(base.parts, "MODL")
    yield Refused("model_followed", base.section("MODL", model + b"\0"), "MODL of 22 bytes (4.1)")


def _groups(base: Base) -> Iterator[Refused]:
    table = content(base.parts, "GRUP")
    yield Refused("groups_none", base.section("GRUP", b""), "no groups (21.2)")
    yield Refused("group_table_cut", base.section("GRUP", table[:-1]), "a table of 81 bytes (21.2)")
    for name, at, new, reason in (
        ("group_of_no_frames", 0, bytes(4), "a group of no frames (21.2)"),
        ("group_of_4097_frames", 0, struct.pack("<I", 4097), "a group of 4097 frames (21.2)"),
        ("group_of_ten_modes", 4, b"\x0a", "10 modes of 3 frames (21.2)"),
        ("group_of_kind_4", 8, b"\x04", "kind 4 (21.2)"),
        ("group_of_kind_8", 8, b"\x08", "kind 8 (21.2)"),
        ("group_of_four_shapes", 4, b"\x04\0\0\0\x05", "4 modes the same on all axes, of 3 frames (21.2)"),
        ("step_zero", 9, _real(0.0), "a step of 0 (21.2)"),
        ("step_nan", 9, _real(math.nan), "a step that is no number (1)"),
        ("step_infinite", 9, _real(math.inf), "a step that is not finite (1)"),
        ("step_beyond", 9, _real(2.0**161), "a step beyond 2^160 (21.2)"),
        ("mode_step_negative", 17, _real(-5e-324), "a negative step of modes (21.2)"),
    ):
        yield Refused(name, base.overwritten("GRUP", at, new), reason)
    unsealed = table[:37] + bytes([table[37] ^ 1]) + table[38:]
    parts = [replace(part, content=unsealed) if part.kind == "GRUP" else part for part in base.parts]
    yield Refused("group_checksum", seal(parts, major=2), "CRC of a group (21.2)")
    cosines = table[:4] + struct.pack("<IB", 3, 0) + table[9:]
    yield Refused("modes_of_cosines", base.section("GRUP", cosines), "bytes of TIME in a group of cosines (21.2)")
    nothing = with_first_group(base.parts, "TIME", b"")
    many = table[:4] + struct.pack("<IB", 4, 0) + content(nothing, "GRUP")[9:]
    yield Refused(
        "group_of_four_cosines",
        seal(with_group_section(nothing, "GRUP", many), major=2),
        "4 cosines of 3 frames (21.2)",
    )


def _chunks(base: Base) -> Iterator[Refused]:
    for kind in CHUNKS:
        section = content(base.parts, kind)
        sizes = [len(chunk) for chunk in group_chunks(base.parts, kind)]
        name = kind.lower()
        cut = with_group_section(base.parts, kind, section[:-1])
        yield Refused(f"{name}_shorter_than_groups", seal(cut, major=2), f"{kind} ends inside a chunk (21.2)")
        longer = with_group_section(base.parts, kind, section + b"\0", sizes=sizes)
        yield Refused(f"{name}_longer_than_groups", seal(longer, major=2), f"{kind} goes on after its chunks (21.2)")
        more = base.first_chunk(kind) + b"\0"
        yield Refused(f"{name}_followed_by_zero", base.chunk(kind, more), "a zero byte too many (19.5)")


def _coefficients(base: Base) -> Iterator[Refused]:
    # Four modes, all zero: a count of three digits may exceed them.
    still = with_first_group(base.parts, "TIME", b"")
    table = content(still, "GRUP")
    still = with_group_section(still, "GRUP", table[:4] + struct.pack("<I", 4) + table[8:])
    seven = seal(with_first_group(still, "COEF", even_bits("111" + "10")), major=2)
    yield Refused("count_beyond_width", seven, "6 functions of time where there are 4 (25.1)")
    functions = GROUP.unpack_from(content(base.parts, "GRUP"))[1]
    levels = np.zeros((base.basis.columns, functions), np.int64)
    levels[0, 0] = 2**40 + 1
    beyond = base.chunk("COEF", encode_levels(levels, base.basis, axes=1))
    yield Refused("level_beyond_2_40", beyond, "a level beyond 2^40 (25)")


def _modes(base: Base) -> Iterator[Refused]:
    time = base.first_chunk("TIME")
    yield Refused("method_of_modes_2", base.chunk("TIME", b"\2" + time[1:]), "method 2 of modes (26)")
    table = content(base.parts, "GRUP")
    none = with_first_group(with_first_group(base.parts, "COEF", b""), "CORR", b"")
    emptied = content(none, "GRUP")
    no_functions = emptied[:4] + bytes(4) + emptied[8:]
    yield Refused(
        "modes_of_no_functions",
        seal(with_group_section(none, "GRUP", no_functions), major=2),
        "bytes of TIME where there are no modes (26)",
    )
    longer = with_group_section(base.parts, "SEQN", count(1025 + 3) + content(base.parts, "SEQN")[1:])
    long_group = with_group_section(longer, "GRUP", struct.pack("<I", 1025) + table[4:])
    yield Refused(
        "transformed_modes_of_1025_frames",
        seal(with_first_group(long_group, "TIME", b"\1" + time[1:]), major=2),
        "modes transformed over 1025 frames (26)",
    )


def _corrections(base: Base) -> Iterator[Refused]:
    # Numbers of corrections in steps and of literals, each plus 1; whether levels are predicted.
    for name, bits, reason in (
        ("corrections_too_many", counted(26) + counted(1) + "0", "25 corrections of 3 frames of 8 vertices (27)"),
        ("corrections_most", "1" * 42 + "1" * 42, "as many corrections as a number can say (27)"),
        ("literals_too_many", counted(1) + counted(26) + "0", "25 literals of 3 frames of 8 vertices (27)"),
        ("literals_without_bytes", counted(1) + counted(4) + "0", "3 literals in less than 24 bytes (27)"),
        ("reference_before_the_group", counted(2) + counted(1) + "00" + "0" + counted(2), "a distance of 2 (27.1)"),
        ("literal_after_the_group", counted(1) + counted(2) + "0" + counted(4) + counted(1), "frame 3 of 3 (27.6)"),
        ("literal_of_place_8", counted(1) + counted(2) + "0" + counted(1) + counted(9), "place 8 of 8 (27.6)"),
        (
            "literal_not_a_number",
            counted(1) + counted(2) + "0" + counted(1) + counted(1) + f"{0x7FC00000:032b}" + "0" * 64,
            "a literal that is no number (27.6)",
        ),
        (
            "literal_infinite",
            counted(1) + counted(2) + "0" + counted(1) + counted(1) + "0" * 64 + f"{0xFF800000:032b}",
            "a literal that is not finite (27.6)",
        ),
    ):
        yield Refused(name, base.chunk("CORR", even_bits(bits)), reason)
    levels = np.zeros((3, 8, 3), np.int64)
    levels[1, 2, 0] = -(2**40) - 1
    beyond = base.chunk("CORR", encode_group(corrected(levels), np.array([0, 8])))
    yield Refused("correction_beyond_2_40", beyond, "a level beyond 2^40 (27.4)")


def _sizes(base: Base) -> Iterator[Refused]:
    sequence, table = content(base.parts, "SEQN"), content(base.parts, "GRUP")
    second = sequence.index(b"p") - 2
    crowd = sequence[:second] + count(2**30) + sequence[second + 1 :]
    yield Refused("limit_vertices_of_groups", base.section("SEQN", crowd), "2^30 vertices (15)", "limit")
    bare = base.parts
    for kind in CHUNKS:
        bare = with_group_section(bare, kind, b"", sizes=[0, 0])
    longest = with_group_section(bare, "SEQN", count(4096) + sequence[1:])
    row = GROUP.pack(4096, 3 * 4096, 1, *GROUP.unpack_from(table)[3:5], 0, 0, 0, 0)
    modes = with_group_section(longest, "GRUP", row)
    yield Refused("limit_modes", seal(modes, major=2), "12288 modes of 4096 frames (15)", "limit")
    many = sequence[:second] + count(100_000) + sequence[second + 1 :]
    wide = with_group_section(bare, "SEQN", count(512) + many[1:])
    row = GROUP.pack(512, 3 * 512, 1, *GROUP.unpack_from(table)[3:5], 0, 0, 0, 0)
    columns = seal(with_group_section(wide, "GRUP", row), major=2)
    yield Refused("limit_columns", columns, "1536 columns of 100006 vertices (15)", "limit")
