"""The vectors with fields (sections 24 and 25) that every decoder must refuse, each damaged in one place."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pdecodec import ArraySequence, ChangingSequence, Field
from pdecodec.codec.sections.fields import COPY, DISPLACEMENT, EXACT, HALVES, MAGNITUDE, VELOCITY
from spec.accepted import Choices, encoded
from spec.accepted_fields import (
    POINT,
    TRIANGLE,
    Header,
    at_rest,
    chunk_of,
    computed_row,
    crc,
    group,
    headers,
    transformed,
    with_sections,
)
from spec.decoder.fields import Fields
from spec.sealing import content, count, take_apart

Damaged = Iterator[tuple[str, bytes, bytes, str]]
"""Yields for each file: its name, FLDS, FDAT, and the reason why decoders refuse it."""

EMPTY = chunk_of(np.zeros((3, 4, 1)), (TRIANGLE, POINT))
GOOD = Header(group(EMPTY))
SINGLE = replace(GOOD, objects=(1,))


def refused_with_fields() -> Iterator[tuple[str, bytes, str, str]]:
    """Yield the name, the bytes, the reason and the error of every file whose fields decoders must refuse."""
    parts = at_rest()
    for name, rows, chunks, reason in (*_chunks(), *_headers(), *_groups(), *_computed()):
        yield name, with_sections(parts, FLDS=rows, FDAT=chunks), reason, "corrupt"
    yield "fields_without_chunks", with_sections(parts, FLDS=headers(GOOD)), "FLDS without FDAT (25)", "corrupt"
    yield from ((name, file, reason, "corrupt") for name, file, reason in _of_runs())
    large = headers(Header(group(b"\0\1", frames=3, in_chunk=4096), components=2**16))
    yield "limit_field", with_sections(parts, FLDS=large, FDAT=b"\0\1"), "4096 frames of 2^18 numbers (20)", "limit"


def _chunks() -> Damaged:
    """Yield a damaged chunk of section 24."""
    number, large, beyond = (chunk_of([[[value]], [[1]], [[7]]]) for value in (9, 2**36, 2**36 - 1))
    function, ones = chunk_of([[[16]]] * 3), chunk_of([[[16]]])
    for name, chunk, reason in (
        ("field_chunk_of_no_bytes", b"", "no bytes (24.2)"),
        ("field_chunk_of_one_byte", b"\0", "one byte (24.2)"),
        ("field_levels_9", b"\x09" + number[1:], "9 levels (24.2)"),
        ("field_method_64", b"\x40" + number[1:], "method 64 (24.2)"),
        ("field_step_of_two_parts", number[:1] + b"\2" + number[2:], "a step of 2 parts (24.2)"),
        ("field_step_of_no_parts", number[:1] + b"\0" + number[2:], "a step of 0 parts (24.2)"),
        ("field_chunk_followed_by_zero", number + b"\0", "a zero byte too many (3.7)"),
        ("field_of_no_functions", transformed(b"", b"", number, ()), "no functions of time (24.2)"),
        ("field_of_four_functions", transformed(function, ones, number, [4] * 4), "4 functions of 3 frames (24.2)"),
        ("field_transform_cut", transformed(function, ones, number)[:6], "ends in its sizes (24.2)"),
        ("field_functions_too_long", transformed(function, ones, number, sizes=(99, 1)), "99 bytes (24.2)"),
        ("field_coefficients_too_long", transformed(function, ones, number, sizes=(1, 99)), "99 bytes (24.2)"),
        ("field_of_23_digits", transformed(function, ones, number, (23,)), "23 digits (24.2)"),
        ("field_coefficient_beyond", transformed(function, ones, number, (2,)), "16 with 2 digits (24.2)"),
        ("field_value_beyond", transformed(chunk_of([[[2**36]]] * 3), ones, large, (3,)), "3 times 2^36 (24.2)"),
        ("field_prediction_beyond", beyond[:1] + b"\xff" + beyond[2:], "255 times 2^36 - 1 (24.6)"),
    ):
        yield name, headers(replace(SINGLE, groups=group(chunk))), chunk, reason


def _headers() -> Damaged:
    """Yield a damaged header."""
    for name, field, reason in (
        ("field_domain_5", replace(GOOD, domain=5), "domain 5 (25.1)"),
        ("field_type_11", replace(GOOD, type=11), "type 11 (25.1)"),
        ("field_of_no_components", replace(GOOD, components=0), "0 components (25.1)"),
        ("field_of_65537_components", replace(GOOD, components=2**16 + 1), "65537 components (25.1)"),
        ("field_name_not_utf8", replace(GOOD, name=b"\xff"), "a name that is not UTF-8 (25.1)"),
        ("field_unit_not_utf8", replace(GOOD, unit=b"\xc3"), "a unit that is not UTF-8 (25.1)"),
        ("field_of_three_objects", replace(GOOD, objects=(0, 0, 0)), "3 of 2 objects (25.1)"),
        ("field_of_object_2", replace(GOOD, objects=(0, 1)), "object 2 of 2 (25.1)"),
        ("field_of_distant_object", replace(GOOD, objects=(2**63 - 1,)), "object 2^63 - 1 (25.1)"),
        ("field_range_inverted", replace(GOOD, limits=(1.0, 0.0, 1.0)), "a range from 1 to 0 (25.1)"),
        ("field_range_nan", replace(GOOD, limits=(math.nan, 0.0, 1.0)), "a range that is no number (1)"),
        ("field_range_infinite", replace(GOOD, limits=(0.0, math.inf, 1.0)), "a range that is not finite (1)"),
        ("field_bound_negative", replace(GOOD, limits=(0.0, 0.0, -1.0)), "a bound below 0 (25.1)"),
        ("field_bound_nan", replace(GOOD, limits=(0.0, 0.0, math.nan)), "a bound that is no number (1)"),
    ):
        yield name, headers(field), EMPTY, reason
    whole = headers(GOOD)
    for name, rows, reason in (
        ("field_name_beyond", b"\1" + count(2**16 + 1) + whole[2:], "a name of 65537 bytes (25.1)"),
        ("field_headers_cut", whole[:-1], "ends in a header (25.1)"),
        ("field_headers_followed", whole + b"\0", "a byte too many (3.1)"),
        ("fields_fewer_than_counted", b"\2" + whole[1:], "one of two headers (25.1)"),
        ("fields_more_than_counted", b"\0" + whole[1:], "a header of no field (25.1)"),
    ):
        yield name, rows, EMPTY, reason
    yield "fields_of_one_name", headers(GOOD, GOOD), 2 * EMPTY, "two fields of one name (25)"


def _groups() -> Damaged:
    """Yield a damaged row of a group."""
    for name, rows, kind, reason in (
        ("field_coding_7", group(EMPTY, 7), 0, "coding 7 (25.2)"),
        ("field_of_no_frames", group(EMPTY, frames=0), 0, "a group of no frames (25.2)"),
        ("field_of_four_frames", group(EMPTY, frames=4), 0, "4 frames of 3 (25.2)"),
        ("field_of_two_frames", group(EMPTY, frames=2), 0, "2 frames of 3 (25.2)"),
        ("field_of_many_frames", group(EMPTY, frames=2**63 - 1), 0, "2^63 - 1 frames of 3 (25.2)"),
        ("field_all_frames_skipped", group(EMPTY, skipped=3), 0, "3 of 3 frames skipped (25.2)"),
        ("field_chunk_of_no_frames", group(EMPTY, in_chunk=0), 0, "a chunk of no frames (25.2)"),
        ("field_chunk_of_4097_frames", group(EMPTY, in_chunk=4097), 0, "a chunk of 4097 frames (25.2)"),
        ("field_halves_of_32_bits", group(EMPTY, HALVES), 4, "halves of 32 bits (25.2)"),
        ("field_quantised_integers", group(EMPTY), 4, "quantised integers (25.2)"),
        ("field_unit_zero", group(EMPTY, unit=0.0), 0, "a unit of 0 (25.2)"),
        ("field_unit_negative", group(EMPTY, unit=-1.0), 0, "a negative unit (25.2)"),
        ("field_unit_nan", group(EMPTY, unit=math.nan), 0, "a unit that is no number (1)"),
        ("field_chunk_too_long", group(EMPTY, size=len(EMPTY) + 1), 0, "a byte more than FDAT has (25.2)"),
        ("field_chunk_far_too_long", group(EMPTY, size=2**63 - 1), 0, "2^63 - 1 bytes (25.2)"),
        ("field_chunk_checksum", group(EMPTY, checksum=1), 0, "CRC of a chunk (25.2)"),
    ):
        yield name, headers(replace(GOOD, type=kind, groups=rows)), EMPTY, reason
    yield "field_values_followed", headers(GOOD), EMPTY + b"\0", "a byte of no chunk (25.1)"


def _computed() -> Damaged:
    """Yield a field that cannot be computed, after a stored one or not."""
    integers = replace(GOOD, type=4, groups=group(EMPTY, EXACT))
    copy = replace(GOOD, name=b"b", groups=computed_row(COPY, 0, 0))
    of_copy = replace(copy, name=b"c", groups=computed_row(COPY, 1, 0))
    size = replace(copy, groups=computed_row(MAGNITUDE, 0))
    size_of_copy = replace(of_copy, groups=computed_row(MAGNITUDE, 1))
    partly = replace(copy, groups=computed_row(COPY, 1, 0, frames=2) + group(EMPTY, frames=1))
    turned = replace(copy, groups=group(EMPTY, frames=2) + computed_row(COPY, 0, 0, frames=1))
    corners, single = chunk_of(np.zeros((3, 3, 1)), (TRIANGLE,), "corner"), chunk_of(np.zeros((3, 1, 1)))
    of_corners = replace(GOOD, domain=2, objects=(0,), groups=group(corners))
    of_one = replace(GOOD, objects=(1,), groups=group(single))
    vector = Header(computed_row(VELOCITY), components=3)
    for name, fields, reason in (
        ("field_of_a_missing_field", [GOOD, replace(copy, groups=computed_row(COPY, 2, 0))], "field 2 of 2"),
        ("field_of_itself", [copy], "a copy of itself"),
        ("fields_of_each_other", [replace(of_copy, name=b"a"), copy], "two copies of each other"),
        ("fields_of_each_other_in_turns", [replace(partly, name=b"a"), turned], "copies of each other's other frames"),
        ("field_of_a_copy", [GOOD, copy, of_copy], "a copy of a copy"),
        ("field_magnitude_of_a_copy", [GOOD, copy, size_of_copy], "a magnitude of a copy"),
        ("field_copied_from_corners", [of_corners, replace(copy, objects=(0,))], "of corners"),
        ("field_copied_from_integers", [integers, copy], "floats copied from integers"),
        ("field_copied_from_an_object", [of_one, copy], "a copy from another object"),
        ("field_copied_from_component_1", [GOOD, replace(copy, groups=computed_row(COPY, 0, 1))], "component 1 of 1"),
        ("field_copied_from_too_few", [GOOD, replace(copy, components=2)], "2 components of 1"),
        ("field_magnitude_of_two", [GOOD, replace(size, components=2)], "a magnitude of 2 components"),
        ("field_magnitude_of_integers", [integers, replace(size, type=4)], "a magnitude of integers"),
        ("field_velocity_of_faces", [replace(vector, domain=1)], "a velocity of faces"),
        ("field_velocity_of_two_axes", [replace(vector, components=2)], "a velocity of 2 components"),
        ("field_velocity_of_integers", [replace(vector, type=4)], "a velocity of integers"),
        ("field_velocity_of_an_object", [replace(vector, objects=(0,))], "a velocity of some objects"),
        ("field_displacement_of_corners", [replace(vector, domain=2, groups=computed_row(DISPLACEMENT))], "of corners"),
    ):
        chunks = b"".join(chunk for chunk in (corners, single, EMPTY) for field in fields if crc(chunk) in field.groups)
        yield name, headers(*fields), chunks, f"{reason} (25.2)"


def _of_runs() -> Iterator[tuple[str, bytes, str]]:
    """Yield files of two runs whose fields are damaged."""
    fields = [(Field("a", "vertex", np.dtype(np.int8)), np.ones((1, 1), np.int8))]
    runs = [ArraySequence(np.zeros((1, 1, 3)), times=[time], fields=fields) for time in (0.0, 1.0)]
    parts = take_apart(encoded(ChangingSequence(runs), Choices()))
    table, rows, values = (content(parts, kind) for kind in ("RFLD", "FLDS", "FDAT"))
    sizes = Fields(table)
    at = len(count(sizes.count()) + count(sizes.count()))
    wrong = table[:at] + bytes([table[at] ^ 1]) + table[at + 1 :]
    for name, new, reason in (
        ("fields_of_runs_without_headers", {"FLDS": None}, "RFLD without FLDS (25.4)"),
        ("fields_of_runs_without_values", {"FDAT": None}, "RFLD without FDAT (25.4)"),
        (
            "fields_of_runs_of_no_bytes",
            {"FLDS": b"", "FDAT": b"", "RFLD": bytes(4)},
            "FLDS of no bytes, as if it were missing (25.4)",
        ),
        ("fields_of_runs_checksum", {"RFLD": wrong}, "CRC of FLDS of a run (25.4)"),
        ("fields_of_runs_cut", {"RFLD": table[:-1]}, "ends in a row (25.4)"),
        ("fields_of_runs_followed", {"RFLD": table + b"\0"}, "a byte too many (3.1)"),
        ("field_headers_of_runs_cut", {"FLDS": rows[:-1]}, "FLDS ends in a run (25.4)"),
        ("field_headers_of_runs_followed", {"FLDS": rows + b"\0"}, "a byte of FLDS of no run (25.4)"),
        ("field_values_of_runs_cut", {"FDAT": values[:-1]}, "FDAT ends in a run (25.4)"),
        ("field_values_of_runs_followed", {"FDAT": values + b"\0"}, "a byte of FDAT of no run (25.4)"),
    ):
        yield name, with_sections(parts, **new), reason
