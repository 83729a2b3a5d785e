"""Sections 1 to 4 of the specification: the container, fields, compressed streams, variable-length integers."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import zstandard

IDENTIFIER = b"\x89PDEANIM\r\n\x1a\n"
IN_BOTH = {"META", "SEQN", "CONN", "REST", "MODL", "COEF", "CORR", "ATTR"}
KNOWN = {1: IN_BOTH | {"SEGM"}, 2: IN_BOTH | {"ORDR", "GRUP", "TIME"}}
"""Sections of each major version."""

MOST_SECTIONS = 64


class CorruptFileError(Exception):
    """The file is not as the specification says."""


def require(condition: bool, complaint: str) -> None:
    """Refuse the file unless `condition` holds."""
    if not condition:
        raise CorruptFileError(complaint)


@dataclass(frozen=True)
class Container:
    """The sections of a file that this decoder knows, by type."""

    major_version: int
    minor_version: int
    sections: dict[str, bytes]

    def __getitem__(self, kind: str) -> bytes:
        require(kind in self.sections, f"section {kind} is missing")
        return self.sections[kind]


def read_container(data: bytes) -> Container:
    """Sections 2 and 3: header, table, and every section checked."""
    require(data[:12] == IDENTIFIER, "not a .pdeanim file")
    require(len(data) >= 28, "ends inside the header")
    major, minor, count, table_checksum, header_checksum = struct.unpack_from("<HHIII", data, 12)
    require(zlib.crc32(data[:24]) == header_checksum, "the header is damaged")
    require(major in KNOWN, f"format version {major} is neither 1 nor 2")
    require(count <= MOST_SECTIONS, f"{count} sections")
    rows, end = [], 28
    for _ in range(count):
        require(end + 5 <= len(data), "the table is cut short")
        size = data[end + 4] >> 4
        require(major == 1 or size <= 8, "a length of more than 8 bytes")
        rows.append(data[end : end + (32 if major == 1 else 9 + size)])
        end += 32 if major == 1 else 9 + size
    require(end <= len(data) and zlib.crc32(data[28:end]) == table_checksum, "the table is damaged")
    sections: dict[str, bytes] = {}
    types = set()
    for row in rows:
        kind, flags = row[:4].decode("latin-1"), row[4]
        if major == 1:
            offset, length, checksum = struct.unpack_from("<QQI", row, 8)
        else:
            offset, length, checksum = end, int.from_bytes(row[5:-4], "little"), int.from_bytes(row[-4:], "little")
        require(offset == end, f"section {kind} does not begin where the one before it ends")
        require(kind not in types, f"section {kind} stands twice")
        types.add(kind)
        end = offset + length
        content = data[offset:end]
        require(len(content) == length, "the file is truncated")
        require(zlib.crc32(content) == checksum, f"section {kind} is damaged")
        if kind in KNOWN[major]:
            sections[kind] = content
        else:
            require(not flags & 1, f"section {kind} is required and unknown")
    require(end == len(data), "bytes follow the last section")
    return Container(major, minor, sections)


class Fields:
    """Section 4.1: the fields of a section, read from front to back."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def _take(self, size: int) -> bytes:
        require(size <= len(self._data) - self._at, "a section ends too early")
        self._at += size
        return self._data[self._at - size : self._at]

    def u8(self) -> int:
        return self._take(1)[0]

    def u32(self) -> int:
        return int.from_bytes(self._take(4), "little")

    def u64(self) -> int:
        return int.from_bytes(self._take(8), "little")

    def f64(self) -> float:
        (value,) = struct.unpack("<d", self._take(8))
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

    def sized(self) -> bytes:
        return self._take(self.u64())

    def text(self, *, short: bool = False) -> str:
        try:
            return self._take(self.count() if short else self.u64()).decode("utf-8")
        except UnicodeDecodeError:
            raise CorruptFileError("a text is not UTF-8") from None

    def integers(self, count: int) -> list[int]:
        return unpack_integers(self.sized(), count)

    def finish(self) -> None:
        require(self._at == len(self._data), "a section has bytes too many")


def decompress(stream: bytes, most: int) -> bytes:
    """Section 4.2: one zstandard frame of 1 to `most` bytes, or nothing."""
    if not stream:
        return b""
    try:
        require(0 < zstandard.frame_content_size(stream) <= most, "a frame declares no size, or one that cannot be")
        return zstandard.ZstdDecompressor().decompress(stream, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise CorruptFileError(f"a compressed stream is damaged: {error}") from None


def unpack_integers(stream: bytes, count: int) -> list[int]:
    """Section 4.3: exactly `count` variable-length integers."""
    values = []
    value = shift = 0
    for byte in decompress(stream, 10 * count):
        require(shift < 63 or (shift == 63 and byte < 2), "an integer is longer than 64 bits")
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            values.append(value >> 1 if value % 2 == 0 else -(value >> 1) - 1)
            value = shift = 0
    require(shift == 0 and len(values) == count, f"a stream does not hold {count} integers")
    return values


def wrapped(value: int) -> int:
    """Section 4.3: a sum modulo 2^64, as a signed number."""
    return (value + 2**63) % 2**64 - 2**63


def running_sums(values: list[int]) -> list[int]:
    """Each value with all before it."""
    sums, total = [], 0
    for value in values:
        total = wrapped(total + value)
        sums.append(total)
    return sums
