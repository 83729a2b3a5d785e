"""The vectors with fields (sections 24 and 25) that every decoder must read, and the clips that they are made from."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import numpy as np

from pdecodec import ArraySequence, ChangingSequence, Connectivity, Field, MeshObject, MeshSequence, _core
from pdecodec.codec.encode.field import sections as field_sections
from pdecodec.codec.encode.field.chunks import FieldCoding, exact_numbers
from pdecodec.codec.sections.connectivity import core_parts
from pdecodec.codec.sections.fields import COPY, EXACT, QUANTISED
from spec.accepted import Choices, clip, connectivity, encoded, grid, noise, wave
from spec.decoder.storedfields import DOMAINS
from spec.sealing import Part, count, seal, take_apart


def two_objects(frames: int, fields: Sequence[tuple[Field, Any]]) -> ArraySequence:
    """Return a sheet of six quads, and five vertices with a triangle and a line, with fields."""
    objects = [MeshObject("sheet", grid(3, 4)), MeshObject("rest", connectivity(5, [(2, 0, 1)], [(1, 3, 4)]))]
    typed = [(field, np.asarray(values).astype(field.dtype)) for field, values in fields]
    return ArraySequence(wave(frames, 1, 17), objects=objects, fields=typed, fps=24)


def of_every_kind(frames: int = 6) -> ArraySequence:
    """Return fields on every domain and of every type, on all objects or on one; some values are not finite."""
    random, along = np.random.default_rng(3), np.arange(frames)[:, None]
    velocity, bits = wave(frames, 1, 17), noise(frames, 5).astype(np.float32)
    velocity[-3:, 4, 0], velocity[1:, 9, 2], velocity[-1, 10, 2] = np.nan, np.inf, -np.inf
    bits[0], bits[1, :2] = [0.0, -0.0, np.inf, -np.inf, np.nan], [1e-45, -3e38]
    whole = random.integers(-(2**63), 2**63 - 1, (frames, 14))
    return two_objects(
        frames,
        [
            (Field("velocity", "vertex", components=3, unit="m/s"), velocity),
            (Field("bits", "vertex", objects=(1,)), bits),
            (Field("age", "vertex", np.int16, objects=(0,)), along // 2 - np.arange(12)),
            (Field("stress", "face", np.float64, unit="Pa"), 1e6 * np.sin(along + np.arange(7))),
            (Field("nass/feucht 水", "face", np.bool_), random.random((frames, 7)) > 0.7),
            (Field("label", "face", np.uint8, objects=(0,)), random.integers(0, 3, (frames, 6)) * 100),
            (Field("shade", "corner", components=2), ((along + np.arange(27))[..., None] / 8) ** 2 * [1.0, -0.5]),
            (Field("index", "corner", np.int32, objects=(1,)), whole[:, :3]),
            (Field("doubles", "object", np.float64), noise(frames, 2) * [1e300, 1e-320]),
            (Field("signed", "object", np.int64, 2), whole[:, :4].reshape(-1, 2, 2)),
            (Field("id", "object", np.uint64), whole[:, 4:6]),
            (Field("small", "object", np.int8), whole[:, 6:8]),
            (Field("word", "object", np.uint16), whole[:, 8:10]),
            (Field("wide", "object", np.uint32), whole[:, 10:12]),
        ],
    )


EXACT_FLOATS = {"bits": "exact", "doubles": "exact"}


def smooth(frames: int) -> ArraySequence:
    """Return a field that few functions of time describe, one that stands still, and one that stops."""
    along, place = np.arange(frames)[:, None], np.arange(17)
    heat = 40 * np.sin(place) * np.cos(along / 3) + 7 * np.cos(2 * place) * np.sin(along / 5)
    still, stops = np.broadcast_to(place, (frames, 17)), np.minimum(along, 5) * np.ones(17)
    return two_objects(
        frames,
        [
            (Field("heat", "vertex"), heat),
            (Field("still", "vertex"), still),
            (Field("stops", "vertex", np.int32), stops),
        ],
    )


def computed(frames: int = 8) -> ArraySequence:
    """Return a wave with its velocity and displacement, and fields that are computed from others."""
    time, place = np.arange(frames)[:, None] / 24, np.linspace(0, 6, 12)
    points = np.stack([0 * time + place, np.sin(place - 3 * time), np.cos(2 * place + 2 * time)], axis=-1)
    slopes = np.stack([0 * time * place, -3 * np.cos(place - 3 * time), -2 * np.sin(2 * place + 2 * time)], axis=-1)
    force = noise(frames, 12, 3).astype(np.float32)
    force[2, 3] = [np.nan, np.inf, 1.0]
    points = points.astype(np.float32)
    return clip(
        points,
        grid(3, 4),
        fps=24,
        fields=[
            (Field("force", "vertex", components=3), force),
            (Field("length", "vertex"), np.sqrt((force.astype(np.float64) ** 2).sum(axis=-1)).astype(np.float32)),
            (Field("sideways", "vertex", components=2), force[..., 1:]),
            (Field("speed", "vertex", np.float64, 3), slopes),
            (Field("pace", "vertex", np.float64), np.sqrt((slopes**2).sum(axis=-1))),
            (Field("moved", "vertex", components=3), points - points[0]),
        ],
    )


def runs_with_fields() -> ChangingSequence:
    """Return three runs: with fields, without, and with other fields."""
    first, last = of_every_kind(2), computed(4)
    last.times = last.times + 2
    return ChangingSequence([first, clip(wave(2, 2, 3), grid(2, 3), times=[1.0, 1.5]), last])


def with_coding(sequence: MeshSequence, coding: FieldCoding, longest: int = 512, **settings: Any) -> bytes:
    """Encode a sequence with one coding for all fields, in groups of at most `longest` frames."""

    def choose(_: object, quantiser: Any, __: object) -> tuple[FieldCoding, None]:
        return (coding if quantiser.step else FieldCoding(coding.levels, 1)), None

    with (
        patch.object(field_sections, "choose_coding", choose),
        patch.object(field_sections, "group_frames", lambda *_: longest),
    ):
        return encoded(sequence, Choices(settings=settings))


@dataclass(frozen=True)
class Header:
    """A header of FLDS. Names and rows of groups are bytes, and `objects` is written as counts, so that all of
    them can be wrong.
    """

    groups: bytes
    name: bytes = b"a"
    domain: int = 0
    type: int = 0
    components: int = 1
    unit: bytes = b""
    objects: tuple[int, ...] = ()
    limits: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def pack(self) -> bytes:
        """Return the bytes of the header."""
        head = count(len(self.name)) + self.name + bytes([self.domain, self.type]) + count(self.components)
        owners = b"".join(map(count, (len(self.objects), *self.objects)))
        return head + count(len(self.unit)) + self.unit + owners + struct.pack("<3d", *self.limits) + self.groups


def headers(*fields: Header) -> bytes:
    """Return section FLDS."""
    return count(len(fields)) + b"".join(field.pack() for field in fields)


def group(
    chunk: bytes,
    code: int = QUANTISED,
    *,
    frames: int = 3,
    skipped: int = 0,
    in_chunk: int = 3,
    unit: float = 0.5,
    size: int | None = None,
    checksum: int | None = None,
) -> bytes:
    """Return the row in FLDS of a group with a chunk."""
    row = bytes([code]) + b"".join(map(count, (frames, skipped, in_chunk)))
    row += struct.pack("<d", unit) if code == QUANTISED else b""
    row += count(len(chunk) if size is None else size)
    return row + (crc(chunk) if checksum is None else struct.pack("<I", checksum))


def crc(chunk: bytes) -> bytes:
    return struct.pack("<I", zlib.crc32(chunk))


def computed_row(code: int, *numbers: int, frames: int = 3) -> bytes:
    """Return the row in FLDS of a group without a chunk: it names the source field and the first component there."""
    return bytes([code]) + b"".join(map(count, (frames, *numbers)))


TRIANGLE, POINT = connectivity(3, [(0, 1, 2)]), connectivity(1)


def chunk_of(
    values: Any,
    parts: Sequence[Connectivity] = (POINT,),
    domain: str = "vertex",
    *,
    kinds: Any = None,
    coding: tuple[int, int] = (0, 1),
) -> bytes:
    """Encode numbers, (frames, rows, components), as a predicted chunk."""
    rows = _core.FieldRows(DOMAINS.index(domain), core_parts(parts))
    own_kinds = None if kinds is None else np.array(kinds, np.uint8)
    return _core.encode_field_chunk(rows, np.array(values, np.int64), own_kinds, *coding)


def transformed(
    functions: bytes, coefficients: bytes, remainder: bytes, digits: Sequence[int] = (4,), sizes: tuple[int, ...] = ()
) -> bytes:
    """Return a transformed chunk."""
    lengths = sizes or (len(functions), len(coefficients))
    return bytes([32, len(digits), *digits]) + struct.pack("<2I", *lengths) + functions + coefficients + remainder


def with_sections(parts: list[Part], **new: bytes | None) -> bytes:
    """Return a file with sections of fields replaced or added; None leaves a section out."""
    kept = [part for part in parts if part.kind not in ("META", *new)]
    return seal([*kept, *(Part(kind, data, 0) for kind, data in new.items() if data is not None)])


def at_rest(frames: int = 3) -> list[Part]:
    """Return the sections of a triangle, and of a vertex without faces, that do not move."""
    objects = [MeshObject("", TRIANGLE), MeshObject("", POINT)]
    return take_apart(encoded(ArraySequence(np.zeros((frames, 4, 3)), objects=objects), Choices()))


def by_hand() -> tuple[bytes, bytes]:
    """Return FLDS and FDAT of nine frames, in a combination that no encoder writes."""
    ramp = chunk_of(np.arange(30).reshape(10, 3, 1) * 11, (TRIANGLE,), coding=(8, 255))
    huge = chunk_of([[[2**36]], [[-(2**36)]], [[1]]])
    kinds = chunk_of([[[5]], [[6]]], kinds=[[[0]], [[1]]])
    floats = chunk_of(exact_numbers(np.array([[[-1.5]], [[2.5]]], np.float32)))
    nothing = chunk_of(np.zeros((2, 0, 1)), domain="face")
    flags = chunk_of([[[0], [1], [7]]], (TRIANGLE,), "corner")
    functions, rest = chunk_of(np.arange(9).reshape(9, 1, 1) * 16, coding=(2, 3)), chunk_of(np.eye(9)[:, :1, None])
    turned = transformed(functions, chunk_of([[[-3]]]), rest)
    of_mixed = group(kinds, frames=2, in_chunk=2) + group(floats, EXACT, frames=7, in_chunk=2)
    cut = group(ramp, frames=4, skipped=8, in_chunk=10)
    rows = [
        # Frames at the start of a chunk are skipped, and its last frame is held.
        Header(cut + group(ramp, frames=5, in_chunk=10), b"cut", objects=(0,)),
        Header(group(huge, frames=9, unit=2.0**-30), b"huge", type=1, objects=(1,)),
        # An integer that is marked as not a number decodes to its prediction.
        Header(group(kinds, EXACT, frames=9, in_chunk=2), b"kinds", type=5, objects=(1,)),
        # The coding changes from group to group.
        Header(of_mixed, b"mixed", objects=(1,)),
        Header(group(nothing, EXACT, frames=9, in_chunk=2), b"nothing", domain=1, type=8, objects=(1,)),
        Header(group(flags, EXACT, frames=9, in_chunk=1), b"", domain=2, type=10, unit=b"1", objects=(0,)),
        Header(group(turned, EXACT, frames=9, in_chunk=9), b"turned", type=4, objects=(1,)),
        # A copy of a later field for some frames, and values of its own afterwards.
        Header(computed_row(COPY, 8, 0, frames=4) + group(huge, frames=5), b"copy", objects=(1,)),
        Header(group(huge, frames=9), b"source", objects=(1,)),
    ]
    return headers(*rows), b"".join((ramp, ramp, huge, kinds, kinds, floats, nothing, flags, turned, huge, huge))


def accepted_with_fields() -> Iterator[tuple[str, bytes]]:
    """Yield the name and bytes of every file with fields that decoders must read."""
    yield "fields", with_coding(of_every_kind(), FieldCoding(0, 1), longest=4, fields=EXACT_FLOATS)
    yield "fields_predicted_between_frames", with_coding(of_every_kind(7), FieldCoding(6, 15), fields=EXACT_FLOATS)
    yield "fields_of_few_functions_of_time", with_coding(smooth(18), FieldCoding(6, 15, 1.0), field_tolerance=1e-4)
    settings = {"fields": {"force": "exact"}, "max_error": 1e-4, "field_tolerance": 1e-2}
    yield "fields_computed", encoded(computed(), Choices(longest_group=5, settings=settings))
    yield "fields_of_runs", encoded(runs_with_fields(), Choices(settings=settings | {"fields": EXACT_FLOATS}))
    rows, chunks = by_hand()
    yield "fields_by_hand", with_sections(at_rest(9), FLDS=rows, FDAT=chunks)
    yield "fields_none", with_sections(at_rest(1), FLDS=b"\0", FDAT=b"")
    # Products that the type cannot hold become infinite (25.3).
    chunk = chunk_of([[[2**36]], [[-(2**36)]], [[-3]]])
    single = Header(group(chunk, unit=2.0**92), b"single", objects=(1,))
    double = Header(group(chunk, unit=2.0**1000), b"double", type=1, objects=(1,))
    yield "fields_beyond_their_types", with_sections(at_rest(), FLDS=headers(single, double), FDAT=2 * chunk)
