"""Sections 1 to 3.2 of the specification: arithmetic of whole numbers, the container, fields, compressed streams."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import zstandard

IDENTIFIER = b"\x89PDEANIM\r\n\x1a\n"
MAJOR_VERSION = 1
NEEDED = ("SEQN", "CONN", "REST", "MODL", "GRUP", "TIME", "COEF", "CORR")
OPTIONAL = ("META", "ORDR", "SOLD", "ATTR", "FLDS", "SCEN")
WITH_FIELDS = ("FDAT", "RFLD")
OF_RUN = ("NAME", "CONN", "ORDR", "REST", "MODL", "GRUP", "TIME", "COEF", "CORR", "ATTR")
OF_RUNS = ("SEQN", "RUNS", "RDAT")
OF_GROUPS = ("TIME", "COEF", "CORR")

LARGEST_REAL = 2.0**160
"""Bound of steps and origins."""


class CorruptFileError(Exception):
    """The file breaks the specification."""


def require(condition: object, complaint: str) -> None:
    """Refuse the file unless `condition` holds."""
    if not condition:
        raise CorruptFileError(complaint)


def bits(number: int) -> int:
    """Count the binary digits of a number's magnitude; 0 has none."""
    return int(number).bit_length()


def clamp(number: int, least: int, most: int) -> int:
    return min(max(number, least), most)


def sign(number: int) -> int:
    return (number > 0) - (number < 0)


def grade(number: int, most: int) -> int:
    """7.1, 13.2: classify magnitudes, two classes per octave."""
    shift = max(bits(number) - 2, 0)
    return min(2 * shift + (number >> shift), most)


def read_container(data: bytes) -> dict[str, bytes]:
    """Sections 2.1 to 2.3: return the sections of a file; missing optional ones are empty."""
    require(data[:12] == IDENTIFIER, "not a .pdeanim file")
    require(len(data) >= 28, "ends inside the header")
    major, _, count, table_checksum, header_checksum = struct.unpack_from("<HHIII", data, 12)
    require(zlib.crc32(data[:24]) == header_checksum, "the header is damaged")
    require(major == MAJOR_VERSION, f"format version {major}")
    require(count <= 64, f"{count} sections")
    table, rows = Fields(data[28:]), []
    for _ in range(count):
        kind, flags = table.take(4).decode("latin-1"), table.u8()
        require(flags >> 4 <= 8, "a length of more than 8 bytes")
        rows.append((kind, flags, int.from_bytes(table.take(flags >> 4), "little"), table.u32()))
    require(zlib.crc32(data[28 : 28 + table.position]) == table_checksum, "the table is damaged")
    sections: dict[str, bytes] = {}
    for kind, flags, length, checksum in rows:
        require(kind not in sections, f"section {kind} appears twice")
        require(
            kind in NEEDED + OPTIONAL + WITH_FIELDS + OF_RUNS or not flags & 1,
            f"section {kind} is required and unknown",
        )
        sections[kind] = table.take(length)
        require(zlib.crc32(sections[kind]) == checksum, f"section {kind} is damaged")
    table.finish()
    has_runs = "RUNS" in sections
    for kind in OF_RUNS if has_runs else NEEDED:
        require(kind in sections, f"section {kind} is missing")
    for kind in OF_RUN if has_runs else ("NAME", "RDAT", "RFLD"):
        require(kind not in sections, f"section {kind} is where it must not be")
    return dict.fromkeys(OPTIONAL, b"") | sections


@dataclass
class Run:
    """Section 2.3: the entry of a run in RUNS."""

    vertices: int
    sections: dict[str, bytes]


def read_runs(table: bytes, data: bytes, count: int) -> list[Run]:
    """Section 2.3: read RUNS and RDAT for `count` runs."""
    fields, stored = Fields(table), Fields(data)
    runs: list[Run] = []
    for _ in range(count):
        vertices, sections = fields.count(), {}
        require(1 <= vertices < 2**31, "a run of too few vertices, or too many")
        for kind in OF_RUN:
            size = fields.count()
            if size == 0:
                require(runs, "the first run lacks a section")
                sections[kind] = runs[-1].sections[kind]
                continue
            sections[kind] = stored.take(size - 1)
            if size > 1 and kind not in OF_GROUPS:
                require(zlib.crc32(sections[kind]) == fields.u32(), f"section {kind} of a run is damaged")
        runs.append(Run(vertices, sections))
    fields.finish()
    stored.finish()
    return runs


class Fields:
    """3.1: reads the fields of a section from front to back."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.position = 0

    def take(self, size: int) -> bytes:
        require(size <= len(self._data) - self.position, "a section ends too early")
        self.position += size
        return self._data[self.position - size : self.position]

    def u8(self) -> int:
        return self.take(1)[0]

    def u32(self) -> int:
        return int.from_bytes(self.take(4), "little")

    def f64(self) -> float:
        (value,) = struct.unpack("<d", self.take(8))
        require(value - value == 0, "a number is not finite")
        return float(value)

    def count(self) -> int:
        value = 0
        for shift in range(0, 63, 7):
            byte = self.u8()
            value |= (byte & 127) << shift
            if byte < 128:
                return value
        raise CorruptFileError("a count has more than 9 bytes")

    def rest(self) -> bytes:
        return self.take(len(self._data) - self.position)

    def finish(self) -> None:
        require(self.position == len(self._data), "a section has bytes too many")


def decompress(stream: bytes, most: int) -> bytes:
    """3.2: decompress one Zstandard frame of 1 to `most` bytes."""
    try:
        require(0 < zstandard.frame_content_size(stream) <= most, "a frame declares no size, or one that cannot be")
        return bytes(zstandard.ZstdDecompressor().decompress(stream, allow_extra_data=False))
    except zstandard.ZstdError as error:
        raise CorruptFileError(f"a compressed stream is damaged: {error}") from None
