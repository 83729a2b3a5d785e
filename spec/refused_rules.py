"""The vectors that every decoder must refuse, second part: rules that small files at rest break, one by one."""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from spec.accepted import Choices, clip, connectivity, encoded, solids_in_runs
from spec.accepted_fields import at_rest
from spec.refused import Base, Refused
from spec.sealing import (
    FRAME_MAGIC,
    Part,
    compressed,
    content,
    count,
    counted,
    numbers,
    scripted,
    seal,
    take_apart,
    take_runs,
    text,
    with_runs,
    with_section,
    zeros,
)

NAMELESS = b"\2\3\1"
"""Counts of CONN in the files at rest: a triangle and a point."""


def signed(number: int) -> str:
    """Return the bits of a number that may be negative (3.6)."""
    return "1" if number == 0 else f"0{number < 0:d}" + numbers(abs(number) - 1)


def refused_rules() -> Iterator[Refused]:
    """Yield every file, in the order of the specification."""
    parts = [part for part in at_rest() if part.kind != "META"]
    for damage in (_container, _streams, _times, _polygons, _attributes, _cells, _remarks, _scenes):
        yield from damage(parts)
    yield from _orders()
    yield from _of_base(Base())


def _container(parts: list[Part]) -> Iterator[Refused]:
    flagged = [Part(part.kind, part.content, 0x0E) for part in parts]
    unknown = Part("XYZW", b"?", 0x0F)
    yield Refused("unknown_required_of_a_minor_version", seal([*flagged, unknown], minor=9), "XYZW is required (2.2)")
    for name, kind, damage, reason in (
        ("flag_of_times", "SEQN", lambda data: data[:2] + bytes([data[2] | 64]) + data[3:], "bit 6 of the flags (4)"),
        ("predictor", "REST", lambda data: data[:32] + b"\x10" + data[33:], "predictor 16 (7.1)"),
        ("space_basis", "MODL", lambda data: b"\4" + data[1:], "bit 2 of the flags (10)"),
        ("field_after_the_groups", "GRUP", lambda data: data + b"\0", "a further field (3.1)"),
    ):
        new = [replace(part, content=damage(part.content)) if part.kind == kind else part for part in parts]
        yield Refused(
            f"minor_version_with_a_{name}", seal(new, minor=1), f"{reason}, which version 1.1 cannot add (21)"
        )
    twice = 2 * [Part("XYZW", b"", 0)]
    of_runs = [*parts, Part("RFLD", b"", 0)]
    yield Refused("runs_of_fields_in_one_run", seal(of_runs), "RFLD in a file of one run (2.3)", section="FLDS")
    yield Refused("unknown_section_twice", seal([*parts, *twice]), "an ignorable section appears twice (2.3)")


def _streams(parts: list[Part]) -> Iterator[Refused]:
    """Yield coded streams that end in other bytes than those of 3.7, but decode to the same."""
    rest = content(parts, "REST")
    head, stream = rest[:33], rest[33:]
    for name, new, reason in (
        ("rest_not_the_lowest", stream[:-1] + bytes([stream[-1] + 1]), "a last byte that is one higher (3.7)"),
        ("rest_not_the_fewest", stream[:-1] + bytes([stream[-1] - 1, 255]), "a byte more than needed (3.7)"),
        ("rest_cut", stream[:-1], "a byte too few (3.7)"),
        ("rest_of_no_bytes", b"", "no bytes (3.7)"),
    ):
        yield Refused(name, seal(with_section(parts, "REST", head + new)), reason)


def _times(parts: list[Part]) -> Iterator[Refused]:
    flags = 28
    head = b"\1\3"
    for name, new, reason in (
        ("frame_rate_negative", bytes([flags - 8]) + struct.pack("<d", -24.0) + b"\0", "a negative frame rate (4)"),
        ("start_beyond", bytes([flags]) + b"\x18" + count(2**53 + 1), "a start beyond 2^53 (4)"),
        (
            "start_infinite",
            bytes([flags - 16]) + b"\x18" + struct.pack("<d", -math.inf),
            "a start that is infinite (1)",
        ),
    ):
        names = content(parts, "SEQN")[5:]
        yield Refused(name, seal(with_section(parts, "SEQN", head + new + names)), reason)
    for name, times, reason in (
        ("listed_times_equal", (0.0, 1.0, 1.0), "two frames at one time (4)"),
        ("listed_time_nan", (0.0, 1.0, math.nan), "a time that is no number (4)"),
    ):
        bits = "".join(f"{byte:08b}" for byte in coded_times(times)) + 2 * text(b"")
        new = scripted(parts, "SEQN", bits, head=head + bytes([2 + 8]) + b"\x18")
        yield Refused(name, seal(new), reason)
    for name, characters, reason in (
        ("name_of_half_a_character", b"\xed\xa0\x80", "a name with a lone surrogate (3.9)"),
        ("name_longer_than_needed", b"\xc0\x80", "a name with a zero in two bytes (3.9)"),
        ("name_beyond_unicode", b"\xf4\x90\x80\x80", "a name with character 110000 (3.9)"),
    ):
        new = scripted(parts, "SEQN", text(characters) + text(b""), head=head + bytes([flags]) + b"\x18\0")
        yield Refused(name, seal(new), reason)


def coded_times(times: tuple[float, ...]) -> bytes:
    """Return the bytes of listed times (4)."""
    places = [struct.unpack("<q", struct.pack("<d", time))[0] for time in times]
    steps = np.diff(np.diff(places, prepend=0), prepend=0).tolist()
    packed = [struct.pack("<Q", (2 * step if step >= 0 else -2 * step - 1) % 2**64) for step in steps]
    return bytes(each[plane] for plane in range(8) for each in packed)


def _polygons(parts: list[Part]) -> Iterator[Refused]:
    none = seal(with_section(parts, "CONN", b"\2\0\0" + content(parts, "CONN")[3:]))
    yield Refused("vertices_none", none, "two objects without vertices (5)")
    few, larger, smaller = (
        "polygons of too few corners",
        "more corners than the surface has",
        "a polygon that does not fit",
    )
    surface = "1 0 0"
    for name, bits, says, reason in (
        ("face_leaves_too_few_corners", numbers(2, 0, 6) + "0" + numbers(1), smaller, "4 of 6 corners (5.2)"),
        ("faces_leave_a_corner", numbers(1, 0, 4) + "0" + numbers(0) + "111", few, "3 of 4 corners (5.2)"),
        ("line_of_no_points", numbers(0, 2, 0, 1), few + ", or too many", "1 point of 2 lines (5.1)"),
        ("line_leaves_no_points", numbers(0, 2, 0, 3, 2), smaller, "3 of 3 points (5.2)"),
        ("surface_leaves_too_few_corners", numbers(2, 0, 6) + surface + "01", larger, "4 of 6 corners (5.3.2)"),
        (
            "surface_leaves_a_corner",
            numbers(1, 0, 4) + surface + "1 111",
            "fewer corners than the surface has",
            "3 of 4 corners (5.3.2)",
        ),
        (
            "surface_vertex_too_far",
            numbers(2, 3) + surface + "111 0 0" + numbers(401),
            "a vertex too far along the border",
            "401 along the border (5.3.4)",
        ),
        (
            "surface_vertex_before_the_first",
            numbers(2, 3) + surface + "111 0 0" + numbers(0, 3),
            "a missing vertex",
            "vertex -1 at a gate (5.3.4)",
        ),
    ):
        yield Refused(name, seal(scripted(parts, "CONN", bits, head=NAMELESS, says=says)), reason)


def _orders() -> Iterator[Refused]:
    """Yield orders of a strip of four triangles that do not fit it."""
    lists = np.array([(0, 1, 2), (2, 1, 3), (2, 3, 4), (4, 3, 5)])
    points = np.arange(18.0).reshape(1, 6, 3)
    parts = take_apart(encoded(clip(points, connectivity(6, lists)), Choices()))
    parts = [part for part in parts if part.kind not in ("META", "ORDR")]
    strip = numbers(4, 3) + "1 0 1" + "111" + "01" + "001" + "001" + numbers(0)
    parts = [*scripted(parts, "CONN", strip, head=b"\1\6"), Part("ORDR", b"")]
    members, lacking, left = numbers(0, 0), "a number that is not left", "a vertex without faces left"
    first = members + "1" + "1111"
    for name, bits, says, reason in (
        ("order_of_all_and_more", numbers(0, 6), "a set that does not fit", "6 of 6 vertices to come (6.1)"),
        ("order_of_vertex_6", numbers(1, 0), "a set that does not fit", "vertices 1 to 6 of 6 (6.1)"),
        ("order_of_face_4", members + signed(4), "a face that is not left", "face 4 of 4 (6.4)"),
        ("order_of_face_before", members + signed(-1), "a face that is not left", "face -1 (6.4)"),
        ("order_number_6", members + "1" + "0" + signed(6), lacking, "number 6 of 6 (6.5)"),
        (
            "order_number_matched",
            members + "10" + signed(1) + 12 * "1",
            lacking,
            "a matched number that is taken (6.5)",
        ),
        ("order_corner_16", first + "0 000" + numbers(14), "a corner too far from the first", "16 corners on (6.3)"),
        ("order_by_vertex_6", first + "0 1" + signed(6), left, "6 vertices on (6.3)"),
        ("order_by_vertex_again", first + "0011011011", left, "a matched vertex without corners left (6.3)"),
        ("order_corner_of_no_face", first + "0 0 0 0 100 1 1", "a face of too few corners", "corner 3 of 3 (6.3)"),
    ):
        yield Refused(name, seal(scripted(parts, "ORDR", bits, says=says)), reason)


def _of_base(base: Base) -> Iterator[Refused]:
    """Yield files in which something moves, and coordinates differ."""
    parts = base.parts
    high = 72 * "0" + 40 * "1" + 39 * "1" + "0" + "00" + "1" + 39 * "0" + "0"
    reference = scripted(
        parts, "REST", high, head=content(parts, "REST")[:32] + b"\0", says="a coordinate out of range"
    )
    yield Refused("coordinate_beyond", seal(reference), "a second vertex beyond 2^40 - 1 (7.6)")
    one, two, beyond = counted(2), counted(3), "a residual is out of range"
    for name, bits, says, reason in (
        (
            "residuals_fewer_than_declared",
            two + counted(1) + "0" + "0 1 0 1 0",
            "there are fewer residuals than declared",
            "none of two residuals (15.3)",
        ),
        (
            "residuals_more_than_declared",
            one + counted(1) + "0" + "1" + 2 * "1 0000" + 6 * "0",
            "there are more residuals than declared",
            "two residuals of one (15.3)",
        ),
        (
            "residual_beyond",
            one + counted(1) + "0 1 1" + 18 * "1" + counted(2**40 - 16, 43) + "0",
            beyond,
            "2^40 + 1 (15.4)",
        ),
        (
            "residual_far_beyond",
            one + counted(1) + "0 1 1" + 18 * "1" + counted(2**42 - 16, 43) + "0",
            beyond,
            "2^42 + 1 (15.4)",
        ),
    ):
        yield Refused(name, seal(scripted(parts, "CORR", bits, group=True, says=says)), reason)


def _attributes(parts: list[Part]) -> Iterator[Refused]:
    """Yield attributes of a triangle."""
    kind, size, number, unit = (
        "an attribute of an unknown kind",
        "an attribute is too large",
        "an integer out of range",
        "a unit out of range",
    )
    table, code = "a table out of range", "a value out of range"
    of_face, floats = numbers(1, 2, 0, 0, 0), numbers(1, 0, 0, 0, 0)
    plain, colours, byte = (
        floats + numbers(128, 0, 1),
        numbers(1, 1, 4, 0, 0) + 3 * numbers(0, 0),
        "a byte out of range",
    )
    for name, bits, says, reason in (
        ("attribute_integers_of_columns", numbers(1, 2, 2, 0), kind, "integers of one column (17.1)"),
        ("attribute_flags_of_columns", numbers(1, 3, 2, 0), kind, "flags of one column (17.1)"),
        ("attribute_colours_without_columns", numbers(1, 1, 0, 0), kind, "colours without columns (17.1)"),
        ("attribute_of_no_columns", numbers(1, 0, 1, 0), kind, "floats of 0 columns (17.1)"),
        ("attribute_fans_of_vertices", numbers(0, 4, 0, 0), kind, "fans of vertices (17.1)"),
        ("attribute_fans_with_indices", numbers(2, 4, 0, 2), kind, "indexed fans (17.1)"),
        ("attribute_fans_of_columns", numbers(2, 4, 2, 0), kind, "fans of one column (17.1)"),
        ("attribute_raw_of_first_used", numbers(0, 5, 0, 3), kind, "raw values of rule 3 (17.1)"),
        ("attribute_of_2_31_columns", numbers(1, 5, 2**31, 0, 0), size, "2^31 - 1 columns (17.1)"),
        ("attribute_of_2_31_elements", numbers(3, 5, 0, 0, 2**31, 0), size, "2^31 elements (17.1)"),
        ("attribute_of_2_31_rows", numbers(0, 5, 0, 2, 2**31, 0), size, "2^31 rows (17.1)"),
        ("attribute_label", numbers(1, 2, 0, 0, 1) + text(b"\xc3"), "a text is not UTF-8", "a cut label (3.9)"),
        ("attribute_row_before", numbers(1, 2, 0, 2, 0, 0) + signed(-2), "an index out of range", "row -2 (17.1)"),
        ("integer_above", of_face + signed(2**31), number, "2^31 (17.4)"),
        ("integer_below", of_face + signed(-(2**31) - 1), number, "-2^31 - 1 (17.4)"),
        ("flag_below", numbers(1, 3, 0, 0, 0) + signed(-1), number, "a flag of -1 (17.4)"),
        ("attribute_shift_128", floats + numbers(256), unit, "a shift of 128 (17.5)"),
        ("attribute_shift_far_below", floats + numbers(0), unit, "a shift of -128 (17.5)"),
        ("attribute_shift_below", floats + numbers(127, 0, 1), unit, "a shift of -1 on a grid (17.5)"),
        ("attribute_divisor_2_31", floats + numbers(128, 0, 2**31), "an unknown scale", "a divisor of 2^31 (17.5)"),
        (
            "attribute_table_of_nothing",
            plain + numbers(1, 0),
            "a table without values",
            "a complete table, empty (17.5)",
        ),
        ("attribute_table_above", plain + numbers(0, 1) + signed(2**31), table, "2^31 in a table (17.5)"),
        (
            "attribute_table_grows",
            plain + numbers(0, 2) + signed(2**31 - 1) + numbers(0),
            table,
            "2^31 in a table (17.5)",
        ),
        (
            "attribute_place_2_of_2",
            plain + numbers(1, 2) + signed(0) + numbers(0) + "110 0 0",
            code,
            "place 2 of 2 (17.7)",
        ),
        ("colour_of_256", colours + 9 * "1" + "0" + 8 * "0" + "0 11", byte, "a colour of 256 (17.5)"),
        ("colour_below", colours + "10 1 11", byte, "a colour of -1 (17.5)"),
        ("attribute_code_above", plain + numbers(0, 0) + "1" * 32 + "0" * 31 + "0", code, "2^31 (17.7)"),
    ):
        with_attributes = [*parts, Part("ATTR", b"")]
        bits = numbers(1) + text(b"a") + bits
        yield Refused(name, seal(scripted(with_attributes, "ATTR", bits, says=says)), reason)


def _cells(parts: list[Part]) -> Iterator[Refused]:
    with_cells = [*parts, Part("SOLD", b"")]
    for name, bits, says, reason in (
        (
            "cell_of_2_31_nodes",
            numbers(1) + "0" + numbers(0, 2**31 - 1),
            "a cell of too many nodes",
            "2^31 nodes (27.1)",
        ),
        (
            "cell_node_before",
            numbers(1) + "0" + numbers(0, 0) + "0" + signed(-1),
            "a missing vertex",
            "vertex -1 (27.1)",
        ),
    ):
        yield Refused(name, seal(scripted(with_cells, "SOLD", bits, says=says)), reason)
    of_runs = [part for part in take_apart(encoded(solids_in_runs(), Choices())) if part.kind != "META"]
    cells, (first, *others) = content(of_runs, "SOLD"), take_runs(of_runs)
    untimed = [part for part in of_runs if part.kind != "SEQN"]
    yield Refused("runs_without_times", seal(untimed), "no SEQN in a file of runs (2.3)")
    bare = with_runs(of_runs, [replace(first, sections=first.sections | {"MODL": b""}), *others])
    yield Refused("run_without_model", seal(bare), "MODL of a run without bytes (2.3)")
    for name, new, reason in (
        ("cells_of_runs_cut", cells[:-1], "ends in a run (27.4)"),
        ("cells_of_runs_followed", cells + b"\0", "a byte of no run (27.4)"),
    ):
        data = [replace(part, content=new) if part.kind == "SOLD" else part for part in of_runs]
        yield Refused(name, seal(data), reason)


def _remarks(parts: list[Part]) -> Iterator[Refused]:
    deep = json.loads('{"a":' * 32 + "{}" + "}" * 32)
    frame = compressed(b"{}")
    for name, data, reason in (
        ("frame_twice", 2 * frame, "two frames (3.2)"),
        ("frame_after_another_kind", b"\x50\x2a\x4d\x18\0\0\0\0" + frame, "a skippable frame before it (3.2)"),
        ("frame_with_a_dictionary", FRAME_MAGIC + b"\x21\x07\x02\x11\0\0{}", "a frame with a dictionary (3.2)"),
        ("frame_unpacks_to_less", FRAME_MAGIC + b"\x20\x03\x11\0\0{}", "3 bytes declared, 2 there (3.2)"),
        ("remarks_of_16_megabytes", zeros(2**24 + 1, 129), "2^24 + 1 bytes (18)"),
        ("remarks_of_33_levels", compressed(json.dumps(deep).encode()), "33 levels (18)"),
        ("remarks_number_in_level_33", compressed(b'{"a":' * 32 + b"0" + b"}" * 32), "a number in level 33 (18)"),
        ("remarks_number_beyond", compressed(b'{"a":1e999}'), "1e999 (18)"),
        ("remarks_integer_beyond", compressed(b'{"a":-1' + 309 * b"0" + b"}"), "-10^309 in digits (18)"),
        (
            "remarks_integer_rounds_to_infinity",
            compressed(b'{"a":%d}' % (int(1.7976931348623157e308) + 2**970)),
            "2^1024 - 2^970, which rounds to infinity (18)",
        ),
        ("remarks_not_a_number", compressed(b'{"a":NaN}'), "NaN, which JSON lacks (18)"),
        ("remarks_half_a_character", compressed(b'{"a":"\\ud800"}'), "a lone surrogate (18)"),
        ("remarks_name_of_half_a_character", compressed(b'{"\\udfff":0}'), "a lone surrogate in a name (18)"),
        ("remarks_not_utf8", compressed(b'{"a":"\xff"}'), "not UTF-8 (18)"),
        ("remarks_in_utf16", compressed("{}".encode("utf-16-le")), "UTF-16 (18)"),
        ("remarks_after_a_mark", compressed(b"\xef\xbb\xbf{}"), "a byte order mark (18)"),
        ("remarks_followed", compressed(b"{}{}"), "two objects (18)"),
    ):
        yield Refused(name, seal([*parts, Part("META", data, 0)]), reason, section="META")


def _scenes(parts: list[Part]) -> Iterator[Refused]:
    frame = compressed(b"x")

    def scene(
        *names: bytes, family: bytes = b"gltf", size: int = 1, data: bytes = frame, outside: bytes = b""
    ) -> bytes:
        row = count(size) + count(len(data)) + struct.pack("<I", zlib.crc32(b"x"))
        rows = b"".join(count(len(name)) + name + row for name in names)
        others = count(1) + count(len(outside)) + outside if outside else b"\0"
        return count(len(family)) + family + b"\0" + others + count(len(names)) + rows + data * len(names)

    of_names = {
        "scene_name_empty": (b"", "an empty name"),
        "scene_name_of_256_bytes": (b"a" * 256, "a name of 256 bytes"),
        "scene_name_of_its_folder": (b"a/./b", "a part ."),
        "scene_name_with_an_empty_part": (b"a//b", "an empty part"),
        "scene_name_that_ends_in_a_slash": (b"a/", "an empty part at the end"),
        "scene_name_that_ends_in_a_full_stop": (b"a./b", "a part that ends with a full stop"),
        "scene_name_that_begins_with_a_space": (b"a/ b", "a part that begins with a space"),
        "scene_name_that_ends_in_a_space": (b"a ", "a part that ends with a space"),
        "scene_name_with_a_backslash": (b"a\\b", "a backslash"),
        "scene_name_with_an_asterisk": (b"a*", "an asterisk"),
        "scene_name_with_a_question_mark": (b"a?", "a question mark"),
        "scene_name_with_a_quotation_mark": (b'"a', "a quotation mark"),
        "scene_name_with_less": (b"a<b", "a sign <"),
        "scene_name_with_more": (b"a>b", "a sign >"),
        "scene_name_with_a_bar": (b"a|b", "a bar"),
        "scene_name_with_a_line_end": (b"a\nb", "a control character"),
        "scene_name_with_a_control_character": (b"a\xc2\x9f", "a control character of Latin-1"),
        "scene_name_not_utf8": (b"a\xff", "a name that is not UTF-8"),
    }
    for name, data, reason in (
        *((name, scene(own), reason) for name, (own, reason) in of_names.items()),
        ("scene_name_that_is_a_folder", scene(b"a/b", b"A"), "a name that is a folder of another"),
        ("scene_text_of_4097_bytes", scene(b"a", outside=b"a" * 4097), "a text of 4097 bytes"),
        ("scene_text_with_an_escape", scene(b"a", outside=b"\x1b[0m"), "a control character in a text"),
        ("scene_family_not_utf8", scene(b"a", family=b"\xc3"), "a family that is not UTF-8"),
        ("scene_stream_without_bytes", scene(b"a", data=b""), "a stream of no bytes for 1 byte"),
        ("scene_cut", scene(b"a")[:-1], "ends in a stream"),
        ("scene_of_more_than_a_terabyte", scene(b"a", b"b", size=2**40), "2^41 bytes"),
    ):
        yield Refused(name, seal([*parts, Part("SCEN", data, 0)]), f"{reason} (26)", section="SCEN")
