"""The vectors that every decoder must refuse: one small file, damaged in one place each, behind its checksums."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pdecodec import ArraySequence, Attribute, EncodeSettings, MeshObject, encode
from spec.accepted import connectivity, grid, noise, wave
from spec.sealing import (
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


@dataclass(frozen=True)
class Refused:
    """A file that every decoder must refuse."""

    name: str
    data: bytes
    reason: str
    error: str = "corrupt"


class Base:
    """The file that is damaged: eight vertices, three frames, moving frames, corrections, a literal, attributes."""

    def __init__(self, folder: Path) -> None:
        points = wave(3, 2, 4) + 0.1 * noise(3, 8, 3)
        group = Attribute("g", "face", np.array([0, 1], np.int32), labels=("a", "b"))
        uv = Attribute("uv", "corner", np.eye(4, 2, dtype=np.float32), np.arange(8, dtype=np.int32) % 4)
        objects = [MeshObject("b", grid(2, 3), (group, uv)), MeshObject("p", connectivity(2))]
        path = folder / "base.pdeanim"
        options = EncodeSettings(profile="segments", alignment="rotation", segment_frames=3, tolerance=0.02)
        encode(ArraySequence(points, objects=objects), path, options, overwrite=True)
        parts = [part for part in take_apart(path.read_bytes()) if part.kind != "META"]
        # Corrections of vertices 1 and 5 at frame 0 and 0 at frame 2, and vertex 4 literally at frame 2.
        corrections = integers(2, 0, 0, 0, 1, 1) + integers(1, 3, 0) + 3 * integers(5, -7, 100)
        literal = integers(4) + sized(compressed(struct.pack("<3f", 1.0, -2.0, 1e20)))
        self.parts = with_chunk(parts, "CORR", corrections + literal)

    def section(self, kind: str, new: bytes) -> bytes:
        """The file with another section, or another chunk of the one segment."""
        return seal((with_chunk if kind in ("COEF", "CORR") else with_section)(self.parts, kind, new))

    def overwritten(self, kind: str, at: int, new: bytes) -> bytes:
        """The file with some bytes of a section overwritten."""
        data = content(self.parts, kind)
        return self.section(kind, data[:at] + new + data[at + len(new) :])

    def stream(self, kind: str, index: int, new: bytes) -> bytes:
        """The file with another content in a section's stream (empty ones do not count)."""
        data = content(self.parts, kind)
        return self.section(kind, with_stream(data, streams(data)[index], new))

    def stream_content(self, kind: str, index: int) -> bytes:
        data = content(self.parts, kind)
        return unpacked(data, streams(data)[index])

    def integer(self, kind: str, index: int, place: int, value: int) -> bytes:
        """The file with another integer in a section's stream."""
        values = split_integers(self.stream_content(kind, index))
        values[place] = varints(value)
        return self.stream(kind, index, b"".join(values))


def refused(folder: Path) -> Iterator[Refused]:
    """Every file, in the order of the specification."""
    base = Base(folder)
    for damage in (_container, _streams, _sequence, _connectivity, _shape, _segments, _chunks, _attributes, _sizes):
        yield from damage(base)


def _real(value: float) -> bytes:
    return struct.pack("<d", value)


def _container(base: Base) -> Iterator[Refused]:
    parts, whole = base.parts, seal(base.parts)
    yield Refused("empty", b"", "no bytes at all (2)")
    yield Refused("another_format", b"\x89PNG\r\n\x1a\n" + bytes(64), "another identifier (2)")
    yield Refused("text_transfer", whole.replace(b"\r\n", b"\n", 1), "a changed line end in the identifier (2)")
    yield Refused("header_cut", whole[:20], "ends inside the header (2)")
    yield Refused("header_checksum", whole[:14] + b"\x08" + whole[15:], "CRC of the header (2)")
    other = seal(parts, major=2)
    yield Refused("major_version_2", other, "the sections of version 1 in a file of version 2 (3)")
    yield Refused("major_version_0", seal(parts, major=0), "a major version that is not known (2)")
    yield Refused("too_many_sections", seal([Part(f"A{k:03}", b"", 0) for k in range(65)]), "65 sections (2)")
    yield Refused("table_checksum", whole[:60] + bytes([whole[60] ^ 1]) + whole[61:], "CRC of the table (2)")
    yield Refused("truncated", whole[:-1], "ends before its last section does (3)")
    yield Refused("trailing_byte", whole + b"\0", "goes on after its last section (3)")
    yield Refused("section_checksum", whole[:-1] + bytes([whole[-1] ^ 1]), "CRC of section ATTR (3)")
    yield Refused("section_twice", seal([*parts, parts[0]]), "section SEQN stands twice (3)")
    yield Refused("unknown_required", seal([*parts, Part("XYZW", b"", 1)]), "an unknown required section (3)")
    for kind in ("SEQN", "CONN", "REST", "MODL", "SEGM", "COEF", "CORR"):
        missing = [part for part in parts if part.kind != kind]
        yield Refused(f"without_{kind.lower()}", seal(missing), f"section {kind} is missing (3)")
    more = base.section("MODL", content(parts, "MODL") + b"\0")
    yield Refused("field_too_many", more, "a section goes on after its last field (4.1)")


def _streams(base: Base) -> Iterator[Refused]:
    frame = compressed(bytes(8))
    for name, stream, reason in (
        ("frame_without_size", frame[:4] + b"\x00\x58" + frame[6:], "a frame that declares no size (4.2)"),
        ("frame_of_nothing", b"\x28\xb5\x2f\xfd\x20\x00\x01\x00\x00", "a frame that declares 0 bytes (4.2)"),
        ("frame_followed", frame + b"\0", "a byte after a frame (4.2)"),
        ("frame_damaged", frame[:4] + b"\xff" + frame[5:], "a frame that is none (4.2)"),
        ("frame_declares_too_much", zeros(2**33, 4), "a frame that declares 8 GiB for 8 integers (4.2)"),
        ("frame_unpacks_to_more", zeros(80, 100), "a frame that declares 80 bytes and holds 12 MiB (4.2)"),
        ("integers_too_few", compressed(bytes(7)), "7 integers in the place of 8 (4.3)"),
        ("integers_too_many", compressed(bytes(9)), "9 integers in the place of 8 (4.3)"),
        ("integer_cut", compressed(bytes(7) + b"\x80"), "a stream that ends inside an integer (4.3)"),
        ("integer_too_long", compressed(b"\xff" * 9 + b"\x02" + bytes(7)), "an integer of 65 bits (4.3)"),
    ):
        rest = content(base.parts, "REST")[:33] + sized(stream) + 2 * sized(frame)
        yield Refused(name, base.section("REST", rest), reason)


def _sequence(base: Base) -> Iterator[Refused]:
    for name, at, new, reason in (
        ("frames_none", 0, bytes(8), "no frames (5)"),
        ("frames_not_in_segments", 0, b"\x02", "2 frames where the segments have 3 (5)"),
        ("frame_rate_zero", 8, _real(0.0), "a frame rate of 0 (5)"),
        ("frame_rate_nan", 8, _real(float("nan")), "a frame rate that is no number (1)"),
        ("rule_of_times", 16, b"\x03", "rule 3 of times (5)"),
        ("times_too_far", 17, _real(2.0**58), "times beyond 2^53 (5)"),
        ("times_too_close", 25, _real(2.0**54), "times less than 2^-53 apart (5)"),
        ("vertices_too_many", 37, struct.pack("<Q", 2**31), "more than 2^31 - 1 vertices (5)"),
        ("name_not_utf8", 53, b"\xff", "a name that is not UTF-8 (4.1)"),
    ):
        yield Refused(name, base.overwritten("SEQN", at, new), reason)
    none = content(base.parts, "SEQN")[:33] + bytes(4)
    yield Refused("objects_none", base.section("SEQN", none), "no objects and so no vertices (5)")


def _connectivity(base: Base) -> Iterator[Refused]:
    yield Refused("index_out_of_range", base.integer("CONN", 0, 0, 6), "a corner at vertex 6 of 6 (6)")
    yield Refused("index_negative", base.integer("CONN", 0, 0, -1), "a corner at vertex -1 (6)")
    yield Refused("index_huge", base.integer("CONN", 0, 1, 2**63 - 1), "a corner beyond all vertices (6)")
    for name, fields, reason in (
        ("sizes_do_not_add_up", (3, 8, 4), "3 times 4 corners are not 8 (6)"),
        ("more_faces_than_corners", (9, 8, 0), "9 faces of 8 corners (6)"),
    ):
        yield Refused(name, base.overwritten("CONN", 0, struct.pack("<QQI", *fields)), reason)
    nothing = struct.pack("<QQI", 0, 0, 0) + 2 * sized(b"")
    narrow = struct.pack("<QQI", 1, 2, 2) + integers(0, 1)
    yield Refused("face_of_two_corners", base.section("CONN", narrow + 3 * nothing), "a face of 2 corners (6)")
    stray = struct.pack("<QQI", 0, 5, 0) + sized(b"") + integers(0, 1, 1, 1, 1)
    yield Refused("corners_without_faces", base.section("CONN", stray + 3 * nothing), "5 corners of no face (6)")


def _shape(base: Base) -> Iterator[Refused]:
    for kind, name, at, new, reason in (
        ("REST", "rest_step_zero", 0, _real(0.0), "a quantisation step of 0 (8.1)"),
        ("REST", "rest_step_huge", 0, _real(2.0**161), "a quantisation step beyond 2^160 (8.1)"),
        ("REST", "origin_huge", 8, _real(-1e300), "an origin beyond 2^160 (8.1)"),
        ("REST", "origin_infinite", 16, _real(float("inf")), "an origin that is not finite (1)"),
        ("REST", "predictor", 32, b"\x03", "predictor 3 (8.1)"),
        ("MODL", "alignment", 0, b"\x03", "alignment 3 (8.2)"),
        ("MODL", "r_too_large", 1, _real(12.5), "r beyond 12 (8.2)"),
        ("MODL", "step_negative", 9, _real(-1.0), "a negative quantisation step (8.2)"),
        ("MODL", "correction_step_huge", 17, _real(2.0**161), "a correction step beyond 2^160 (8.2)"),
        ("MODL", "columns", 25, b"\x01", "another number of columns than the elements have (8.2)"),
    ):
        yield Refused(name, base.overwritten(kind, at, new), reason)
    yield Refused("level_negative", base.integer("REST", 0, 0, -1000000), "a negative level (8.1)")
    yield Refused("level_too_large", base.integer("REST", 2, 0, 2**40), "a level of 2^40 or more (8.1)")
    yield Refused("piece_length", base.integer("MODL", 0, 0, 16), "piece length 16 (8.2)")


def _segments(base: Base) -> Iterator[Refused]:
    table = content(base.parts, "SEGM")
    yield Refused("segment_table_cut", base.section("SEGM", table[:-1]), "a table of 23 bytes (10.1)")
    yield Refused("segments_none", base.section("SEGM", b""), "no segments (10.1)")
    for name, at, new, reason in (
        ("segment_of_no_frames", 0, bytes(4), "a segment of no frames (10.1)"),
        ("segment_of_65_frames", 0, b"\x41", "a segment of 65 frames (10.1)"),
        ("alpha_nan", 4, struct.pack("<f", float("nan")), "an alpha that is no number (10.1)"),
        ("alpha_too_large", 4, struct.pack("<f", 12.5), "alpha beyond 12 (10.1)"),
        ("exponent_negative", 8, struct.pack("<h", -1), "a negative exponent (10.1)"),
        ("exponent_too_large", 8, struct.pack("<h", 513), "an exponent of 513 (10.1)"),
        ("chunk_beyond_section", 12, struct.pack("<I", 2**32 - 1), "a chunk longer than COEF (10.1)"),
    ):
        yield Refused(name, base.overwritten("SEGM", at, new), reason)
    longer = [replace(part, content=part.content + b"\0") if part.kind == "COEF" else part for part in base.parts]
    yield Refused("coefficients_too_long", seal(longer), "COEF goes on after its last chunk (10.1)")
    wrong = table[:20] + bytes([table[20] ^ 1]) + table[21:]
    unsealed = [replace(part, content=wrong) if part.kind == "SEGM" else part for part in base.parts]
    yield Refused("segment_checksum", seal(unsealed), "CRC of a segment (10.1)")


def _chunks(base: Base) -> Iterator[Refused]:
    yield Refused("coefficient_too_large", base.integer("COEF", 0, 0, 2**40 + 1), "a level beyond 2^40 (11.1)")
    yield Refused("coefficients_too_few", base.stream("COEF", 0, b"\0"), "one coefficient (11.1)")
    yield Refused("pose_too_large", base.integer("COEF", 1, 1, -(2**42)), "a moving frame beyond 2^40 (11.2)")
    yield Refused("correction_count_negative", base.integer("CORR", 0, 0, -1), "-1 corrections (11.3)")
    yield Refused("correction_count_huge", base.integer("CORR", 0, 0, 2**62), "2^62 corrections (11.3)")
    yield Refused("correction_gap_negative", base.integer("CORR", 1, 1, -1), "a negative gap (11.3)")
    yield Refused("correction_vertex", base.integer("CORR", 1, 0, 8), "vertex 8 of 8 (11.3)")
    yield Refused("correction_too_large", base.integer("CORR", 2, 0, 2**41), "a level beyond 2^40 (11.3)")
    literals = base.stream_content("CORR", 6)
    nan = struct.pack("<f", float("nan"))
    yield Refused("literal_nan", base.stream("CORR", 6, nan + literals[4:]), "a literal that is no number (11.3)")
    yield Refused("literals_too_few", base.stream("CORR", 6, literals[:-4]), "a literal cut short (11.3)")


def _attributes(base: Base) -> Iterator[Refused]:
    domain = 4 + 8 + 1  # behind the number of attributes and the name of the first
    yield Refused("attribute_domain", base.overwritten("ATTR", domain, b"\x04"), "domain 4 (13.1)")
    yield Refused("attribute_type", base.overwritten("ATTR", domain + 1, b"\x05"), "type 5 of values (13.1)")
    yield Refused("attribute_dimensions", base.overwritten("ATTR", domain + 2, b"\x00"), "no dimensions (13.1)")
    yield Refused("attribute_rows", base.overwritten("ATTR", domain, b"\x00"), "2 rows for 6 vertices (13.1)")
    yield Refused("attribute_index", base.integer("ATTR", 3, 0, 4), "row 4 of 4 (13.1)")
    yield Refused("labels_not_json", base.stream("ATTR", 1, b'["a"'), "labels that are not JSON (13.1)")
    yield Refused("labels_not_texts", base.stream("ATTR", 1, b"[1]"), "labels that are not strings (13.1)")
    for name, data, reason in (
        ("remarks_not_an_object", compressed(b"[]"), "META is an array (13.2)"),
        ("remarks_not_json", compressed(b"{"), "META is not JSON (13.2)"),
        ("remarks_too_long", zeros(2**33, 4), "META of 8 GiB (13.2)"),
    ):
        yield Refused(name, seal([*base.parts, Part("META", data, 0)]), reason)


def _sizes(base: Base) -> Iterator[Refused]:
    vertices = base.overwritten("SEQN", 37, struct.pack("<Q", 2**30))
    yield Refused("limit_vertices", vertices, "2^30 vertices (15)", "limit")
    corners = base.overwritten("CONN", 0, struct.pack("<QQI", 2**30, 2**32, 4))
    yield Refused("limit_corners", corners, "2^32 corners (15)", "limit")
    values = struct.pack("<I", 1) + sized(b"a") + struct.pack("<BBBQ", 3, 4, 1, 2**31 - 1) + sized(zeros(2**34, 4))
    values += struct.pack("<Q", 0) + sized(b"") + struct.pack("<I", 0)
    yield Refused("limit_values", base.section("ATTR", values), "16 GiB of attribute values (15)", "limit")
