"""Read damaged `.pdeanim` files as far as possible, with a repaired header and table of sections.

The decoder refuses a file with a wrong header, table or length. This module lists these faults, and presents the
file to the decoder with a valid header, zeros in place of a missing end, and nothing after its last section. Every
section and every group of frames has its own checksum, so all content that the decoder then accepts is as it was
written.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import BinaryIO, Literal, cast

from pdecodec.codec.container import (
    CHECKSUM,
    COPY_BLOCK_BYTES,
    ENTRY_HEAD,
    HEADER,
    IDENTIFIER,
    LENGTH_WIDTH_SHIFT,
    MAJOR_VERSION,
    REQUIRED,
    SECTION_KINDS,
    StoredSection,
)
from pdecodec.errors import CorruptFileError, ErrorCode, LimitError

MAX_SECTIONS = 64
"""Largest number of sections (the specification's section 2.1)."""

MAX_LENGTH_BYTES = 8
"""Largest width of a section's length (the specification's section 2.2)."""


@dataclass(frozen=True)
class Finding:
    """One fault of a file.

    Attributes
    ----------
    code : ErrorCode
    message : str
        One line.
    severity : {"error", "note"}
        Whether the file breaks the format, or this is only good to know.
    section : str, optional
        Its four letters.
    run, group : int, optional
        From 0; a group's number is within its run.
    frames : (int, int), optional
        The frames concerned: the first, and the one after the last.
    offset : int, optional
        Byte of the file.
    """

    code: ErrorCode
    message: str
    severity: Literal["error", "note"] = "error"
    section: str | None = None
    run: int | None = None
    group: int | None = None
    frames: tuple[int, int] | None = None
    offset: int | None = None


@dataclass(frozen=True)
class ListedSection(StoredSection):
    """A row of the table of sections, as the file has it."""

    type: str
    is_required: bool


class MendedFile(io.RawIOBase):
    """A file with a replaced beginning and its declared length: zeros replace a missing end.

    Parameters
    ----------
    file : binary file
        Stays the caller's.
    head : bytes
        Replaces as many bytes at the beginning.
    size : int [bytes]
    name : str
        For messages.
    """

    def __init__(self, file: BinaryIO, head: bytes, size: int, name: str) -> None:
        self._file, self._head, self._size, self.name = file, head, size, name
        self._at = 0

    def seekable(self) -> bool:
        return True

    def readable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self._at = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._size}[whence]
        return self._at

    def read(self, count: int = -1) -> bytes:
        left = max(0, self._size - self._at)
        count = left if count < 0 else min(count, left)
        found = self._head[self._at : self._at + count]
        if len(found) < count:
            self._file.seek(self._at + len(found))
            found += self._file.read(count - len(found))
        self._at += count
        return found.ljust(count, b"\0")


def mended(file: BinaryIO, name: str, most_missing: int) -> tuple[BinaryIO, list[ListedSection], list[Finding]]:
    """Return a file that the decoder accepts as far as it is sound, its sections, and the faults of header, table and
    length.

    Parameters
    ----------
    file : binary file
        Stays the caller's, who keeps it open.
    name : str
    most_missing : int [bytes]
        Largest allowed difference between the declared and the actual length, because zeros in place of the missing
        bytes take memory.

    Raises
    ------
    CorruptFileError
        If it is not a `.pdeanim` file, has a later major version, or its table cannot be read; `code` says which.
    LimitError
        If more than `most_missing` is missing at its end.
    """
    size = file.seek(0, io.SEEK_END)
    file.seek(0)
    header = file.read(HEADER.size)
    if header[: len(IDENTIFIER)] != IDENTIFIER[: len(header)] or not header:
        reason = "not a .pdeanim file (its first bytes differ); pdecodec encode makes one"
        raise CorruptFileError(reason, code="identifier", offset=0)
    if len(header) < HEADER.size:
        raise CorruptFileError("ends inside its header", code="truncated", offset=len(header))
    _, major, minor, count, table_checksum, checksum = HEADER.unpack(header)
    findings = []
    is_sound = zlib.crc32(header[: -CHECKSUM.size]) == checksum
    if not is_sound:
        findings.append(Finding(ErrorCode.HEADER_CHECKSUM, "its header is damaged", offset=0))
    elif major != MAJOR_VERSION:
        reason = f"has format version {major}, this decoder reads version {MAJOR_VERSION}; update pdecodec"
        raise CorruptFileError(reason, code="version", offset=12)
    if count > MAX_SECTIONS:
        raise CorruptFileError(f"declares {count} sections, the most is {MAX_SECTIONS}", code="table", offset=16)
    table, sections = _read_table(file, count)
    if zlib.crc32(table) != table_checksum:
        findings.append(Finding(ErrorCode.TABLE_CHECKSUM, "its table of sections is damaged", offset=HEADER.size))
    end = sections[-1].offset + sections[-1].length if sections else HEADER.size
    if end - size > most_missing:
        if findings:
            reason = f"its table of sections is damaged: it declares {end} bytes"
            raise CorruptFileError(reason, code="table", offset=HEADER.size)
        raise LimitError(
            f"declares {end} bytes, but has {size}; restoring its length exceeds the memory limit of {most_missing}",
            path=name,
            limit="max_memory",
        )
    if end > size:
        findings.append(
            Finding(ErrorCode.TRUNCATED, f"is truncated: {size} bytes where its table says {end}", offset=size)
        )
    elif end < size:
        findings.append(Finding(ErrorCode.TRAILING_BYTES, f"has {size - end} bytes after its last section", offset=end))
    unsealed = HEADER.pack(IDENTIFIER, MAJOR_VERSION, minor, count, zlib.crc32(table), 0)[: -CHECKSUM.size]
    head = unsealed + CHECKSUM.pack(zlib.crc32(unsealed)) + table
    return cast(BinaryIO, MendedFile(file, head, end, name)), sections, findings


def _read_table(file: BinaryIO, count: int) -> tuple[bytes, list[ListedSection]]:
    """Return the table's bytes and its rows; raise an error if a section occurs twice."""
    rows: list[bytes] = []
    found: list[ListedSection] = []
    for _ in range(count):
        row = file.read(ENTRY_HEAD.size)
        size = row[-1] >> LENGTH_WIDTH_SHIFT if len(row) == ENTRY_HEAD.size else MAX_LENGTH_BYTES + 1
        row += file.read(size + CHECKSUM.size)
        if size > MAX_LENGTH_BYTES or len(row) < ENTRY_HEAD.size + size + CHECKSUM.size:
            raise CorruptFileError("its table of sections cannot be read", code="table", offset=HEADER.size)
        rows.append(row)
    offset = HEADER.size + sum(map(len, rows))
    for row in rows:
        kind, flags = ENTRY_HEAD.unpack_from(row)
        length = int.from_bytes(row[ENTRY_HEAD.size : -CHECKSUM.size], "little")
        (checksum,) = struct.unpack("<I", row[-CHECKSUM.size :])
        name = kind.decode("ascii", "backslashreplace")
        if any(name == one.type for one in found):
            reason = f"section {name} appears twice in its table"
            raise CorruptFileError(reason, code="table", section=name, offset=HEADER.size)
        found.append(ListedSection(offset, length, checksum, name, bool(flags & REQUIRED)))
        offset += length
    return b"".join(rows), found


def damaged_sections(file: BinaryIO, sections: Sequence[ListedSection]) -> list[Finding]:
    """Return findings about unknown sections, and about sections whose bytes do not match the table."""
    findings = []
    for section in sections:
        if section.type not in SECTION_KINDS or section.type == "NAME":  # NAME occurs only in section RDAT
            code = ErrorCode.SECTION_UNKNOWN_REQUIRED if section.is_required else ErrorCode.SECTION_UNKNOWN
            findings.append(
                Finding(
                    code,
                    f"section {section.type} is unknown" + ("; update pdecodec" if section.is_required else ""),
                    "error" if section.is_required else "note",
                    section=section.type,
                    offset=section.offset,
                )
            )
        if _checksum(file, section) != section.checksum:
            findings.append(
                Finding(
                    ErrorCode.SECTION_CHECKSUM,
                    f"section {section.type} is damaged",
                    section=section.type,
                    offset=section.offset,
                )
            )
    return findings


def _checksum(file: BinaryIO, section: StoredSection) -> int | None:
    """Return the CRC-32 of a section's bytes, None if some are missing."""
    file.seek(section.offset)
    left, checksum = section.length, 0
    while left:
        piece = file.read(min(left, COPY_BLOCK_BYTES))
        if not piece:
            return None
        left -= len(piece)
        checksum = zlib.crc32(piece, checksum)
    return checksum
