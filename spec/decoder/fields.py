"""Sections 2, 3.1 and 3.2 of the specification: the container, fields, compressed streams."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import zstandard

IDENTIFIER = b"\x89PDEANIM\r\n\x1a\n"
MAJOR_VERSION = 1
KNOWN = {"META", "SEQN", "CONN", "ORDR", "REST", "MODL", "GRUP", "TIME", "COEF", "CORR", "ATTR"}

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

    minor_version: int
    sections: dict[str, bytes]

    def __getitem__(self, kind: str) -> bytes:
        require(kind in self.sections, f"section {kind} is missing")
        return self.sections[kind]


def read_container(data: bytes) -> Container:
    """Section 2: header, table, and every section checked."""
    require(data[:12] == IDENTIFIER, "not a .pdeanim file")
    require(len(data) >= 28, "ends inside the header")
    major, minor, count, table_checksum, header_checksum = struct.unpack_from("<HHIII", data, 12)
    require(zlib.crc32(data[:24]) == header_checksum, "the header is damaged")
    require(major == MAJOR_VERSION, f"format version {major}")
    require(count <= MOST_SECTIONS, f"{count} sections")
    rows, end = [], 28
    for _ in range(count):
        require(end + 5 <= len(data), "the table is cut short")
        size = data[end + 4] >> 4
        require(size <= 8, "a length of more than 8 bytes")
        rows.append(data[end : end + 9 + size])
        end += 9 + size
    require(end <= len(data) and zlib.crc32(data[28:end]) == table_checksum, "the table is damaged")
    sections: dict[str, bytes] = {}
    types = set()
    for row in rows:
        kind, flags = row[:4].decode("latin-1"), row[4]
        length, checksum = int.from_bytes(row[5:-4], "little"), int.from_bytes(row[-4:], "little")
        require(kind != "CONN" or kind not in types, "runs of frames of different connectivity")
        require(kind not in types, f"section {kind} stands twice")
        types.add(kind)
        content = data[end : end + length]
        end += length
        require(len(content) == length, "the file is truncated")
        require(zlib.crc32(content) == checksum, f"section {kind} is damaged")
        if kind in KNOWN:
            sections[kind] = content
        else:
            require(not flags & 1, f"section {kind} is required and unknown")
    require(end == len(data), "bytes follow the last section")
    return Container(minor, sections)


class Fields:
    """Section 3.1: the fields of a section, read from front to back."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.position = 0

    def _take(self, size: int) -> bytes:
        require(size <= len(self._data) - self.position, "a section ends too early")
        self.position += size
        return self._data[self.position - size : self.position]

    def u8(self) -> int:
        return self._take(1)[0]

    def u32(self) -> int:
        return int.from_bytes(self._take(4), "little")

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

    def rest(self) -> bytes:
        return self._take(len(self._data) - self.position)

    def finish(self) -> None:
        require(self.position == len(self._data), "a section has bytes too many")


def decompress(stream: bytes, most: int) -> bytes:
    """Section 3.2: one zstandard frame of 1 to `most` bytes, or nothing."""
    if not stream:
        return b""
    try:
        require(0 < zstandard.frame_content_size(stream) <= most, "a frame declares no size, or one that cannot be")
        return zstandard.ZstdDecompressor().decompress(stream, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise CorruptFileError(f"a compressed stream is damaged: {error}") from None
