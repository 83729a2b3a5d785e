"""The vectors that every decoder must refuse: one small file, damaged in one place each, with valid checksums."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pdecodec import ArraySequence, Attribute, MeshObject
from spec.accepted import Choices, clip, connectivity, encoded, grid, noise, runs_of_one_frame, solids, soup, wave
from spec.sealing import (
    CHUNKS,
    Part,
    Row,
    RunParts,
    compressed,
    content,
    count,
    counted,
    group_chunks,
    numbers,
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


@dataclass(frozen=True)
class Refused:
    """A file that every decoder must refuse, or only decoders that read ``section`` if it is given."""

    name: str
    data: bytes
    reason: str
    error: str = "corrupt"
    section: str | None = None


class Base:
    """The file to damage: two quads with six vertices, two points, six frames in two groups of trajectories.

    Vertex 3 is raw in frame 2; other vertices have residuals.
    """

    def __init__(self) -> None:
        points = wave(6, 2, 4) + 0.1 * noise(6, 8, 3)
        points[2, 3] += 1e20
        objects = [MeshObject("b", grid(2, 3)), MeshObject("p", connectivity(2))]
        data = encoded(ArraySequence(points, objects=objects), Choices(longest_group=3, settings={"tolerance": 0.02}))
        self.parts = [part for part in take_apart(data) if part.kind != "META"]
        self.rows = take_rows(content(self.parts, "GRUP"))[0]

    def section(self, kind: str, new: bytes) -> bytes:
        """Return the file with another section."""
        return seal(with_section(self.parts, kind, new))

    def overwritten(self, kind: str, at: int, new: bytes) -> bytes:
        """Return the file with some bytes of a section overwritten."""
        data = content(self.parts, kind)
        return self.section(kind, data[:at] + new + data[at + len(new) :])

    def chunk(self, kind: str, new: bytes) -> bytes:
        """Return the file with another chunk in the first group."""
        return seal(with_first_group(self.parts, kind, new))


def refused() -> Iterator[Refused]:
    """Yield every file, in the order of the specification."""
    base = Base()
    for damage in (_container, _sequence, _connectivity, _reference, _model, _groups, _chunks, _scripts):
        yield from damage(base)
    for damage in (_attributes, _remarks, _sizes, _scenes):
        yield from damage(base)
    yield from _runs(base)
    yield from _cells(base)


def _real(value: float) -> bytes:
    return struct.pack("<d", value)


def _flipped(data: bytes, at: int) -> bytes:
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]


def _container(base: Base) -> Iterator[Refused]:
    parts, whole = base.parts, seal(base.parts)
    long = whole[:28] + whole[28:32] + b"\x91" + whole[33:]
    for name, data, reason in (
        ("empty", b"", "no bytes at all (2.1)"),
        ("another_format", b"\x89PNG\r\n\x1a\n" + bytes(64), "another identifier (2.1)"),
        ("text_transfer", whole.replace(b"\r\n", b"\n", 1), "a changed line end in the identifier (2.1)"),
        ("header_cut", whole[:20], "ends inside the header (2.1)"),
        ("header_checksum", whole[:14] + b"\x08" + whole[15:], "CRC of the header (2.1)"),
        ("major_version_0", seal(parts, major=0), "a major version that is not known (2.1)"),
        ("major_version_2", seal(parts, major=2), "a major version that is not known (2.1)"),
        ("table_of_65_rows", seal([Part(f"A{k:03}", b"", 0) for k in range(65)]), "65 sections (2.1)"),
        ("row_checksum", _flipped(whole, table_end(parts[:2]) + 5), "CRC of the table (2.1)"),
        ("row_of_nine_bytes_of_length", long, "a length of 9 bytes (2.2)"),
        ("row_cut", whole[: table_end(parts) - 1], "ends inside its table (2.2)"),
        ("last_section_cut", whole[:-1], "ends before its last section does (2.2)"),
        ("last_section_checksum", _flipped(whole, len(whole) - 1), "CRC of section CORR (2.2)"),
        ("bytes_after_the_last_section", whole + b"\0", "goes on after its last section (2.2)"),
        ("section_twice", seal([*parts, parts[0]]), "section SEQN appears twice (2.2)"),
        ("second_run", seal([*parts, *(part for part in parts if part.kind == "CONN")]), "a second CONN (2.3)"),
        ("unknown_required", seal([*parts, Part("XYZW", b"", 1)]), "an unknown required section (2.2)"),
    ):
        yield Refused(name, data, reason)
    for kind in ("SEQN", "CONN", "REST", "MODL", "GRUP", *CHUNKS):
        missing = [part for part in parts if part.kind != kind]
        yield Refused(f"without_{kind.lower()}", seal(missing), f"section {kind} is missing (2.2)")


def _sequence(base: Base) -> Iterator[Refused]:
    names = content(base.parts, "SEQN")[len(sequence(6)) :]
    usual, nan, alone = 28, _real(math.nan), 8  # flags: times use the frame rate; frame rate and start are counts
    tiny, late = _real(0.0) + _real(5e-324), _real(2.0**54)
    for name, head, reason in (
        ("runs_none", sequence(6, flags=usual, runs=0), "no run (4)"),
        ("runs_two", sequence(6, flags=usual, runs=2), "two runs (2.3)"),
        ("frames_none", sequence(0, flags=usual), "no frames (4)"),
        ("frames_fewer_than_in_groups", sequence(5, flags=usual), "5 frames where the groups have 6 (12)"),
        ("frames_more_than_in_groups", sequence(7, flags=usual), "7 frames where the groups have 6 (12)"),
        ("frame_rate_zero", sequence(6, flags=usual, fps=b"\0"), "a frame rate of 0 (4)"),
        ("frame_rate_nan", sequence(6, flags=usual - 8, fps=nan), "a frame rate that is no number (1)"),
        ("frame_rate_beyond", sequence(6, flags=usual, fps=count(2**53 + 1)), "a frame rate beyond 2^53 (4)"),
        ("flag_of_times_64", sequence(6, flags=usual + 64), "an unknown flag (4)"),
        ("jumps_none", sequence(6, flags=usual + 32) + b"\0", "no jumps where they are declared (4)"),
        ("jump_at_the_first_frame", sequence(6, flags=usual + 32) + b"\1\0", "a jump at frame 0 (4)"),
        ("jump_twice", sequence(6, flags=usual + 32) + b"\2\3\0", "two jumps at one frame (4)"),
        ("jump_beyond", sequence(6, flags=usual + 32) + b"\2\3\3", "a jump at frame 6 of 0 to 5 (4)"),
        ("jumps_more_than_frames", sequence(6, flags=usual + 32) + b"\6" + b"\1" * 6, "6 jumps in 6 frames (4)"),
        ("listed_times_at_the_frame_rate", sequence(6, rule=2, flags=usual), "listed times with a rate (4)"),
        ("times_beyond", sequence(6, flags=12, times=late), "times beyond 2^53 (4)"),
        ("times_too_close", sequence(6, rule=1, flags=alone, times=_real(0.0) + late), "times too close (4)"),
        ("period_of_rate_zero", sequence(6, rule=3, flags=alone, times=2 * _real(0.0)), "a rate of 0 (4)"),
        ("period_infinite", sequence(6, rule=3, flags=alone, times=tiny), "an infinite period (4)"),
        ("count_of_ten_bytes", b"\1" + b"\xff" * 9 + b"\1" + sequence(6, flags=usual)[2:], "10 bytes (3.1)"),
    ):
        yield Refused(name, base.section("SEQN", head + names), reason)
    head = sequence(6, flags=usual)
    for name, bits, reason in (
        ("name_not_utf8", text(b"\xfe") + text(b""), "a name that is not UTF-8 (3.9)"),
        ("name_without_end", text(b"b") + 9 * f"{98:08b}", "a name that does not end (3.9)"),
    ):
        yield Refused(name, seal(scripted(base.parts, "SEQN", bits, head=head)), reason)
    yield Refused("names_cut", base.section("SEQN", head + names[:-1]), "ends inside a name (3.7)")
    yield Refused("sequence_followed", base.section("SEQN", head + names + b"\0"), "a zero byte too many (3.7)")


def _connectivity(base: Base) -> Iterator[Refused]:
    conn = content(base.parts, "CONN")
    for name, new, reason in (
        ("objects_none", b"\0", "no objects and so no vertices (5)"),
        ("objects_fewer_than_names", b"\1\x06" + conn[3:], "a name too many (3.7)"),
        ("vertices_too_many", b"\2\6" + count(2**31 - 6) + conn[3:], "2^31 vertices (5)"),
        ("conn_followed_by_zero", conn + b"\0", "a zero byte too many (3.7)"),
    ):
        yield Refused(name, base.section("CONN", new), reason)
    points = take_apart(encoded(clip(wave(3, 2, 3)), Choices()))
    yield Refused("order_of_nothing", seal([*points, Part("ORDR", b"\1")]), "an order without a surface (6)")


def _reference(base: Base) -> Iterator[Refused]:
    rest = content(base.parts, "REST")
    for name, at, new, reason in (
        ("step_of_rest_zero", 0, _real(0.0), "a step of 0 (7.1)"),
        ("origin_beyond", 24, _real(-(2.0**161)), "an origin beyond 2^160 (7.1)"),
        ("predictor_8", 32, b"\x08", "ties without welds (7.1)"),
        ("predictor_16", 32, b"\x10", "predictor 16 (7.1)"),
    ):
        yield Refused(name, base.overwritten("REST", at, new), reason)
    yield Refused("rest_header_cut", base.section("REST", rest[:32]), "no predictor (7.1)")
    yield Refused("rest_followed_by_zero", base.section("REST", rest + b"\0"), "a zero byte too many (3.7)")
    yield Refused("rest_followed_by_byte", base.section("REST", rest + b"\1"), "a byte too many (3.7)")
    yield Refused("rest_without_end", base.section("REST", rest[:-8]), "8 bytes too few (3.7)")


def _model(base: Base) -> Iterator[Refused]:
    model = content(base.parts, "MODL")
    curves = b"\1" + model[1:4]
    for name, new, reason in (
        ("space_basis_4", b"\4" + model[1:], "space basis 4 (10)"),
        ("still_in_no_bytes", b"\2" + model[1:12] + b"\0" + model[12:], "0 bytes of vertices that stand still (10)"),
        ("still_beyond_the_end", b"\2" + model[1:12] + b"\xff\1" + model[12:], "255 bytes, more than there are (10)"),
        ("still_in_too_many", b"\2" + model[1:12] + b"\5" + b"\xff" * 5 + model[12:], "bytes too many (3.7)"),
        ("patches_of_no_points", model[:1] + b"\0" + model[2:], "patches of 0 points (10)"),
        ("patches_of_257_points", model[:1] + count(257) + model[2:], "patches of 257 points (10)"),
        ("pieces_of_65536_points", b"\1" + count(65536) + curves[2:] + bytes(9) + model[4:], "65536 points (10)"),
        ("patches_of_no_functions", model[:2] + b"\0" + model[3:], "patches of 0 functions (10)"),
        ("patches_of_129_functions", model[:2] + b"\x81" + model[3:], "patches of 129 functions (10)"),
        ("threshold_8", model[:3] + b"\x08" + model[4:], "threshold 8 (10)"),
        ("rate_negative", curves + _real(-1.0) + b"\1" + model[4:], "a rate below 0 (10)"),
        ("rate_beyond", curves + _real(12.5) + b"\1" + model[4:], "a rate of 12.5 (10)"),
        ("affine_2", curves + _real(0.0) + b"\2" + model[4:], "2 where affine functions are, or not (10)"),
        ("correction_step_zero", model[:4] + _real(0.0) + model[12:], "a step of 0 (10)"),
        ("correction_step_beyond", model[:4] + _real(2.0**161) + model[12:], "a step beyond 2^160 (10)"),
        ("model_followed", model + b"\0", "a zero byte too many (3.7)"),
    ):
        yield Refused(name, base.section("MODL", new), reason)


def _groups(base: Base) -> Iterator[Refused]:
    first, second = base.rows
    table = content(base.parts, "GRUP")
    still = replace(first, reals=first.reals[:8], sizes=(0, *first.sizes[1:]))
    yield Refused("groups_none", base.section("GRUP", b""), "no groups (12)")
    yield Refused("group_table_cut", base.section("GRUP", table[:-1]), "a table that ends in a row (12)")
    unsealed = table[: len(first.pack()) - 1] + _flipped(table[len(first.pack()) - 1 :], 0)
    parts = [replace(part, content=unsealed) if part.kind == "GRUP" else part for part in base.parts]
    yield Refused("group_checksum", seal(parts), "CRC of a group (12)")
    for name, row, reason in (
        ("group_of_no_frames", replace(first, frames=0), "a group of no frames (12)"),
        ("group_of_4097_frames", replace(first, frames=4097), "a group of 4097 frames (12)"),
        ("group_of_ten_trajectories", replace(first, functions=10), "10 trajectories of 3 frames (12)"),
        ("group_of_four_shapes", replace(first, functions=4, kind=1), "4 shapes of 3 frames (12)"),
        ("group_of_kind_8", replace(first, kind=8), "kind 8 (12)"),
        ("step_zero", replace(first, reals=_real(0.0) + first.reals[8:]), "a step of 0 (12)"),
        ("step_nan", replace(first, reals=_real(math.nan) + first.reals[8:]), "a step that is no number (1)"),
        ("step_infinite", replace(first, reals=_real(math.inf) + first.reals[8:]), "a step that is not finite (1)"),
        ("step_beyond", replace(first, reals=_real(2.0**161) + first.reals[8:]), "a step beyond 2^160 (12)"),
        ("step_of_time_negative", replace(first, reals=first.reals[:8] + _real(-5e-324)), "a negative step (12)"),
        ("alpha_negative", replace(still, kind=3, functions=3, reals=still.reals + _real(-1.0)), "alpha < 0 (12)"),
        ("alpha_beyond", replace(still, kind=3, functions=3, reals=still.reals + _real(12.5)), "alpha of 12.5 (12)"),
    ):
        yield Refused(name, _with_rows(base, row, second), reason)
    parts = with_section(base.parts, "TIME", group_chunks(base.parts, "TIME")[1], sizes=[0, first.sizes[0]])
    closed = replace(still, kind=3, functions=3, reals=still.reals + _real(1.0))
    for name, row, reason in (
        ("group_of_four_cosines", replace(still, kind=2, functions=4), "4 cosines of 3 frames (12)"),
        ("group_of_four_in_closed_form", replace(closed, functions=4), "4 functions of 3 frames (12)"),
        ("closed_form_beside_others", closed, "a group in closed form next to one that is not (12)"),
    ):
        yield Refused(name, seal(with_section(parts, "GRUP", row.pack() + second.pack())), reason)


def _with_rows(base: Base, *rows: Row) -> bytes:
    return base.section("GRUP", b"".join(row.pack() for row in rows))


def _chunks(base: Base) -> Iterator[Refused]:
    for kind in CHUNKS:
        section, chunks = content(base.parts, kind), group_chunks(base.parts, kind)
        name = kind.lower()
        yield Refused(f"{name}_shorter_than_groups", base.section(kind, section[:-1]), f"{kind} ends in a chunk (12)")
        longer = with_section(base.parts, kind, section + b"\0", sizes=[len(chunk) for chunk in chunks])
        yield Refused(f"{name}_longer_than_groups", seal(longer), f"{kind} goes on after its chunks (12)")
        yield Refused(f"{name}_followed_by_zero", base.chunk(kind, chunks[0] + b"\0"), "a zero byte too many (3.7)")
    time = group_chunks(base.parts, "TIME")[0]
    yield Refused("method_of_time_3", base.chunk("TIME", b"\3" + time[1:]), "method 3 of functions of time (13.1)")
    first, second = base.rows
    none = with_first_group(with_first_group(base.parts, "COEF", b""), "CORR", b"")
    rows = replace(first, functions=0).pack() + second.pack()
    bare = seal(with_section(none, "GRUP", rows))
    yield Refused("time_of_no_functions", bare, "bytes of TIME for no functions (13.1)")
    longer = with_section(base.parts, "SEQN", b"\1" + count(1025 + 3) + content(base.parts, "SEQN")[2:])
    longer = with_section(longer, "GRUP", replace(first, frames=1025).pack() + second.pack())
    long = seal(with_first_group(longer, "TIME", b"\1" + time[1:]))
    yield Refused("transformed_over_1025_frames", long, "functions of time transformed over 1025 frames (13.1)")


def _scripts(base: Base) -> Iterator[Refused]:
    """Yield files whose coded streams are written bit by bit, as the decoder reads them."""
    # Scripts for the first face of the first object: number of faces, size, number of corners or whether they form a
    # surface, and the first face. Scripts for residuals: their number plus 1, the number of raw vertices plus 1,
    # whether residuals are predicted, then the frames.
    few, quad, one = "polygons of too few corners, or too many", counted(2) + counted(5), counted(1) + counted(2)
    nan, infinite = f"{0x7FC00000:032b}", f"{0xFF800000:032b}"
    many, gone = "there are more residuals than there can be", "a missing raw vertex"
    for name, kind, bits, says, reason in (
        ("face_of_two_corners", "CONN", counted(2) + counted(3), "polygons of too few corners", "2 corners (5.1)"),
        ("corners_too_few", "CONN", counted(3) + counted(1) + counted(6), few, "5 corners of 2 faces (5.1)"),
        ("corners_too_many", "CONN", counted(2) + counted(1) + "1" * 31 + f"{1:031b}", few, "2^31 corners (5.1)"),
        ("index_out_of_range", "CONN", quad + "0 000" + counted(6), "a missing vertex", "vertex 6 (5.2)"),
        ("index_negative", "CONN", quad + "0 001" + counted(1), "a missing vertex", "vertex -1 (5.2)"),
        (
            "surface_of_seven_vertices",
            "CONN",
            counted(2) + counted(8) + "100 1111111",
            "more vertices than the object has",
            "a face of 7 vertices of 6 (5.3.4)",
        ),
        (
            "vertex_before_the_first",
            "CONN",
            quad + "100 0" + counted(1),
            "a missing vertex",
            "vertex -1 (5.3.4)",
        ),
        ("weld_before_the_first", "REST", "1" + counted(1), "a missing point", "an old first point (7.3)"),
        (
            "coordinate_negative",
            "REST",
            72 * "0" + "11" + "00" + "1",
            "a coordinate out of range",
            "a first vertex at -2 (7.6)",
        ),
        ("residuals_too_many", "CORR", counted(26) + counted(1), many, "25 residuals of 3 frames of 8 vertices (15)"),
        ("residuals_most", "CORR", "1" * 42 + "1" * 42 + counted(1), many, "all residuals a number can say (15)"),
        ("raw_too_many", "CORR", counted(1) + counted(26), many, "25 raw vertices of 3 frames of 8 vertices (15)"),
        (
            "raw_without_bytes",
            "CORR",
            counted(1) + counted(4),
            "there are more raw vertices than bytes for them",
            "3 raw vertices in less than 24 bytes (15)",
        ),
        (
            "reference_before_the_group",
            "CORR",
            counted(2) + counted(1) + "0 0 0" + counted(2),
            "a reference is before the first frame",
            "2 back (15.1)",
        ),
        ("raw_after_the_group", "CORR", one + "0" + counted(4) + counted(1), gone, "frame 3 of 3 (15.6)"),
        ("raw_of_place_8", "CORR", one + "0" + counted(1) + counted(9), gone, "place 8 of 8 (15.6)"),
        (
            "raw_not_a_number",
            "CORR",
            one + "0" + 2 * counted(1) + nan + "0" * 64,
            "a raw vertex is not finite",
            "no number (15.6)",
        ),
        (
            "raw_infinite",
            "CORR",
            one + "0" + 2 * counted(1) + "0" * 64 + infinite,
            "a raw vertex is not finite",
            "infinite (15.6)",
        ),
    ):
        yield Refused(name, seal(_script(base, kind, bits, says)), reason)
    tied = take_apart(encoded(soup(3, 3, 3), Choices()))
    raw = scripted(tied, "CORR", one + "0" + counted(1) + counted(10), group=True, says=gone)
    yield Refused("raw_of_a_tied_vertex", seal(raw), "place 9 of 9, of 16 vertices (15.6)")
    # The count of the first context band, then for its channel: a nonzero block, sign, exponent, digits.
    beyond = "10" + "1 0" + "1" * 40 + "0" * 39 + "1"
    yield Refused(
        "coefficient_beyond_2_40", seal(_script(base, "COEF", beyond, "a coefficient out of range")), "2^40 + 1 (14)"
    )
    still = with_first_group(base.parts, "TIME", b"")
    first, second = base.rows
    rows = replace(first, functions=4, kind=0, sizes=(0, *first.sizes[1:])).pack() + second.pack()
    still = scripted(
        with_section(still, "GRUP", rows), "COEF", "111 10", group=True, says="more functions of time than there are"
    )
    yield Refused("count_beyond_width", seal(still), "6 functions of time where there are 4 (14.1)")


def _script(base: Base, kind: str, bits: str, says: str = "") -> list[Part]:
    rest = content(base.parts, "REST")[:32] + bytes(["point" in says])
    head = {"REST": rest, "CONN": b"\2\6\2"}.get(kind, b"")
    return scripted(base.parts, kind, bits, head=head, group=kind in CHUNKS, says=says)


def _attributes(base: Base) -> Iterator[Refused]:
    unknown, floats = "an attribute of an unknown kind", text(b"u") + numbers(1, 0, 0, 0, 0, 128)
    for name, bits, says, reason in (
        ("attribute_domain", text(b"a") + numbers(5, 0), unknown, "domain 5 (17.1)"),
        ("attribute_kind", text(b"a") + numbers(0, 10), unknown, "kind 10 (17.1)"),
        ("attribute_rule", text(b"a") + numbers(0, 2, 0, 9), unknown, "rule 9 (17.1)"),
        ("attribute_by_vertex_of_faces", text(b"a") + numbers(1, 2, 0, 1), unknown, "faces by vertex (17.1)"),
        ("attribute_of_five_columns", text(b"a") + numbers(0, 0, 6, 0), unknown, "5 columns of floats (17.1)"),
        ("attribute_name", text(b"\xfe"), "a text is not UTF-8", "a name that is not UTF-8 (3.9)"),
        ("attribute_row_0_of_0", text(b"a") + numbers(1, 2, 0, 2, 0, 0) + "1" + "1", ROWS, "row 0 of 0 (17.1)"),
        ("flag_of_256", text(b"a") + numbers(1, 3, 0, 0, 0) + "1 00" + numbers(255), FLAG, "a flag of 256 (17.4)"),
        ("attribute_scale_3", floats + numbers(3, 1), "an unknown scale", "scale 3 (17.5)"),
        ("attribute_divisor_0", floats + numbers(0, 0), "an unknown scale", "a divisor of 0 (17.5)"),
        ("attribute_shift_31", text(b"u") + numbers(1, 0, 0, 0, 0, 159, 0, 1), UNIT, "a shift of 31 (17.5)"),
    ):
        with_attributes = [*base.parts, Part("ATTR", b"")]
        yield Refused(name, seal(scripted(with_attributes, "ATTR", numbers(1) + bits, says=says)), reason)
    group = Attribute("g", "face", np.array([0, 1], np.int32), labels=("a", "b"))
    objects = [MeshObject("b", grid(2, 3), (group,))]
    parts = take_apart(encoded(ArraySequence(wave(2, 2, 3), objects=objects), Choices()))
    longer = with_section(parts, "ATTR", content(parts, "ATTR") + b"\0")
    yield Refused("attributes_followed_by_zero", seal(longer), "a zero byte too many (3.7)")


ROWS, FLAG, UNIT = "an index out of range", "an integer out of range", "a unit out of range"


def _cells(base: Base) -> Iterator[Refused]:
    with_cells, one = [*base.parts, Part("SOLD", b"")], counted(2)
    for name, bits, says, reason in (
        ("cell_like_none", one + "1", "a cell like one before the first", "the first cell as the one before (27.1)"),
        ("cell_shape", one + "0" + counted(10), "a cell of an unknown shape", "shape 9 (27.1)"),
        ("cell_node", one + "0" + 2 * counted(1) + "000" + counted(6), "a missing vertex", "vertex 6 of 6 (27.1)"),
    ):
        yield Refused(name, seal(scripted(with_cells, "SOLD", bits, says=says)), reason)
    huge = scripted(with_cells, "SOLD", one + "0" + counted(1) + counted(2**28))
    yield Refused("limit_cells", seal(huge), "2^28 nodes of a cell (20)", "limit")
    parts = [part for part in take_apart(encoded(solids(), Choices())) if part.kind != "META"]
    longer = with_section(parts, "SOLD", content(parts, "SOLD") + b"\0")
    yield Refused("cells_followed", seal(longer), "a byte too many (3.7)")


def _remarks(base: Base) -> Iterator[Refused]:
    frame = compressed(b"{}")
    for name, data, reason in (
        ("frame_without_size", frame[:4] + b"\x00\x58" + frame[6:], "a frame that declares no size (3.2)"),
        ("frame_of_nothing", b"\x28\xb5\x2f\xfd\x20\x00\x01\x00\x00", "a frame that declares 0 bytes (3.2)"),
        ("frame_followed", frame + b"\0", "a byte after a frame (3.2)"),
        ("frame_damaged", frame[:4] + b"\xff" + frame[5:], "a frame that is none (3.2)"),
        ("frame_declares_too_much", zeros(2**33, 4), "a frame that declares 8 GiB (18)"),
        ("frame_unpacks_to_more", zeros(80, 100), "a frame that declares 80 bytes and holds 12 MiB (3.2)"),
        ("remarks_not_an_object", compressed(b"[]"), "META is an array (18)"),
        ("remarks_not_json", compressed(b"{"), "META is not JSON (18)"),
    ):
        yield Refused(name, seal([*base.parts, Part("META", data, 0)]), reason, section="META")


def _scenes(base: Base) -> Iterator[Refused]:
    frame = compressed(b"x")

    def scene(
        name: bytes = b"a", size: int = 1, sum_of: bytes = b"x", data: bytes = frame, head: bytes = b"\x04gltf"
    ) -> bytes:
        row = count(len(name)) + name + count(size) + count(len(data)) + struct.pack("<I", zlib.crc32(sum_of))
        return head + b"\0\0\x01" + row + data

    two = count(1) + b"a" + count(1) + count(len(frame)) + struct.pack("<I", zlib.crc32(b"x"))
    for name, data, reason, error in (
        ("scene_without_a_format", scene(head=b"\0"), "a family without a name (26)", "corrupt"),
        ("scene_without_streams", b"\x04gltf\0\0\0", "no streams (26)", "corrupt"),
        ("scene_with_a_long_list", b"\x04gltf" + count(2**16 + 1), "2^16 + 1 kinds (26)", "corrupt"),
        ("scene_name_above", scene(b"../a"), "a name that leads above its folder (26)", "corrupt"),
        ("scene_name_absolute", scene(b"/a"), "a name that begins at the root (26)", "corrupt"),
        ("scene_name_with_a_drive", scene(b"c:a"), "a name with a colon (26)", "corrupt"),
        (
            "scene_name_twice",
            b"\x04gltf\0\0\x02" + two + two.replace(b"a", b"A", 1) + 2 * frame,
            "a name twice (26)",
            "corrupt",
        ),
        ("scene_stream_of_another_size", scene(size=2), "a stream of another size (26)", "corrupt"),
        ("scene_stream_damaged", scene(sum_of=b"y"), "a stream with another CRC (26)", "corrupt"),
        (
            "scene_stream_unpacks_to_more",
            scene(size=80, data=zeros(80, 100)),
            "80 bytes that are 12 MiB (26)",
            "corrupt",
        ),
        ("scene_stream_of_nothing", scene(size=0), "a stream without content (26)", "corrupt"),
        ("scene_followed", scene() + b"\0", "a byte after the streams (26)", "corrupt"),
        ("scene_of_a_terabyte", scene(size=2**40, data=zeros(2**40, 1)), "a scene of 2^40 bytes (26)", "limit"),
    ):
        yield Refused(name, seal([*base.parts, Part("SCEN", data, 0)]), reason, error, section="SCEN")


def _runs(base: Base) -> Iterator[Refused]:
    """Yield files of three runs, of which the last two have the same faces."""
    parts = [part for part in take_apart(encoded(runs_of_one_frame(), Choices())) if part.kind != "META"]
    runs = take_runs(parts)
    first = runs[0]
    table, data, times = (content(parts, kind) for kind in ("RUNS", "RDAT", "SEQN"))

    def changed(**new: bytes) -> bytes:
        return seal([replace(part, content=new.get(part.kind, part.content)) for part in parts])

    def with_first(run: RunParts) -> bytes:
        return seal(with_runs(parts, [run, *runs[1:]]))

    lacking = RunParts(first.vertices, first.sections | {"MODL": None})
    named = RunParts(first.vertices, first.sections | {"NAME": (first.sections["NAME"] or b"") + b"\1"})
    longer = RunParts(first.vertices, first.sections | {"GRUP": b"\2" + (first.sections["GRUP"] or b"")[1:]})
    wrong = first.row({"CONN": 1}) + table[len(first.row()) :]
    group = (first.sections["GRUP"] or b"")[:-1] + b"\1"
    unsealed = RunParts(first.vertices, first.sections | {"GRUP": group})
    for name, file, reason in (
        ("runs_without_data", seal([part for part in parts if part.kind != "RDAT"]), "no RDAT (2.3)"),
        ("runs_without_table", seal([part for part in parts if part.kind != "RUNS"]), "several runs, no RUNS (2.3)"),
        ("run_data_in_a_file_of_one_run", seal([*base.parts, Part("RDAT", b"")]), "RDAT without RUNS (2.3)"),
        ("names_in_a_file_of_one_run", seal([*base.parts, Part("NAME", b"", 0)]), "NAME without RUNS (2.3)"),
        ("runs_beside_a_run", seal([*parts, *base.parts[1:2]]), "CONN in a file with RUNS (2.3)"),
        ("runs_in_a_run", seal([*parts, Part("NAME", b"", 0)]), "NAME in a file with RUNS (2.3)"),
        ("runs_more_than_rows", changed(SEQN=b"\6\1" + times[1:]), "six runs, rows of five (2.3)"),
        ("runs_fewer_than_rows", changed(SEQN=b"\4" + times[2:]), "four runs, rows of five (2.3)"),
        ("runs_of_more_frames", changed(SEQN=times[:1] + b"\2" + times[2:]), "2 frames where the groups have 1 (12)"),
        ("run_of_no_frames", changed(SEQN=times[:1] + b"\0" + times[2:]), "a run of no frames (4)"),
        ("runs_with_names_of_all", changed(SEQN=times + names_of(base)), "names in SEQN (4)"),
        ("run_table_cut", changed(RUNS=table[:-1]), "a table that ends in a row (2.3)"),
        ("run_table_followed", changed(RUNS=table + b"\0"), "a byte too many (3.1)"),
        ("run_data_cut", changed(RDAT=data[:-1]), "RDAT ends in a run (2.3)"),
        ("run_data_followed", changed(RDAT=data + b"\0"), "bytes of no run (2.3)"),
        ("run_of_other_vertices", with_first(replace(first, vertices=13)), "13 vertices of 12 (2.3)"),
        ("run_of_no_vertices", with_first(replace(first, vertices=0)), "no vertices (2.3)"),
        ("run_of_too_many_vertices", with_first(replace(first, vertices=2**31)), "2^31 vertices (2.3)"),
        ("first_run_as_before", with_first(lacking), "a first run as the one before (2.3)"),
        ("run_checksum", changed(RUNS=wrong), "CRC of a section of a run (2.3)"),
        ("run_group_checksum", with_first(unsealed), "CRC of a group of a run (12)"),
        ("run_of_more_frames_in_groups", with_first(longer), "a group of 2 frames in a run of 1 (12)"),
        ("run_names_followed", with_first(named), "a byte too many (3.7)"),
    ):
        yield Refused(name, file, reason)
    many = count(2) + 2 * count(2**62)
    yield Refused("limit_frames_of_runs", changed(SEQN=many + times[6:]), "2^63 frames (20)", "limit")
    crowd = RunParts(2**30, first.sections | {"CONN": b"\1" + count(2**30) + (first.sections["CONN"] or b"")[2:]})
    yield Refused("limit_vertices_of_a_run", with_first(crowd), "2^30 vertices in a run (20)", "limit")


def names_of(base: Base) -> bytes:
    """Return the coded names of the objects of a file."""
    return content(base.parts, "SEQN")[len(sequence(6)) :]


def _sizes(base: Base) -> Iterator[Refused]:
    crowd = b"\2\6" + count(2**30) + content(base.parts, "CONN")[3:]
    yield Refused("limit_vertices", base.section("CONN", crowd), "2^30 vertices (20)", "limit")
    corners = seal(_script(base, "CONN", counted(2**28 + 1) + counted(5)))
    yield Refused("limit_corners", corners, "2^30 corners (20)", "limit")
    frames = 4096
    bare = with_section(base.parts, "SEQN", b"\1" + count(frames) + content(base.parts, "SEQN")[2:])
    for kind in CHUNKS:
        bare = with_section(bare, kind, b"", sizes=[0, 0])
    row = replace(base.rows[0], frames=frames, functions=3 * frames, sizes=(0, 0, 0))
    file = seal(with_section(bare, "GRUP", row.pack()))
    yield Refused("limit_time", file, "12288 trajectories of 4096 frames (20)", "limit")
