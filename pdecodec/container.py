"""The container: identifier, header, table of sections, sections (``spec/pdeanim.md``, sections 1 to 3)."""

from __future__ import annotations

import os
import struct
import tempfile
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from pdecodec.errors import CorruptFileError
from pdecodec.whole_output import whole_file, write_errors

IDENTIFIER = b"\x89PDEANIM\r\n\x1a\n"
"""As PNG's: a byte that is not ASCII, the name, and line ends that a text transfer would change."""

MAJOR_VERSION, MINOR_VERSION = 1, 0

HEADER = struct.Struct("<12sHHIII")
"""Identifier, major and minor version, number of sections, CRC-32 of the table, CRC-32 of all before."""

ENTRY_HEAD = struct.Struct("<4sB")
"""Type, and flags with sixteen times the bytes that the length takes. The length and the CRC-32 follow: a section
begins where the one before it ends."""

CHECKSUM = struct.Struct("<I")

LENGTH_AT, MOST_LENGTH_BYTES = 4, 8
"""Bit of the flags at which the bytes of a length begin to be counted, and how many they are at most."""

RUN_BEGINS = "CONN"
"""Frames of one connectivity are a run; its sections begin with this one. This version reads files of one run."""

REQUIRED = 1
"""Section flag: a decoder that does not know this type must refuse the file."""

MAX_SECTIONS = 64
"""A run of frames has 9 sections at most; more can only be damage."""

COPY_BYTES = 2**20
"""Bytes copied or checked at a time, so that memory does not grow with a section."""


@dataclass(frozen=True)
class SectionEntry:
    """One row of the table of sections."""

    type: str
    required: bool
    offset: int
    length: int
    checksum: int


class Spool:
    """A section that grows while frames stream by: an unnamed temporary file, in `folder` if one is given."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder or Path(tempfile.gettempdir())
        with write_errors(self._folder):
            self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 - lives as long as the spool, see close()
        self.length = 0
        self.checksum = 0

    def append(self, data: bytes) -> None:
        with write_errors(self._folder):
            self._file.write(data)
        self.length += len(data)
        self.checksum = zlib.crc32(data, self.checksum)

    def pieces(self) -> Iterable[bytes]:
        self._file.seek(0)
        while piece := self._file.read(COPY_BYTES):
            yield piece

    def close(self) -> None:
        self._file.close()


@dataclass(frozen=True)
class Section:
    """A section to be written.

    Attributes
    ----------
    type : str
        Four ASCII letters.
    content : bytes or Spool
    required : bool
        Whether a decoder that does not know the type must refuse the file.
    """

    type: str
    content: bytes | Spool
    required: bool = True

    @property
    def length(self) -> int:
        return self.content.length if isinstance(self.content, Spool) else len(self.content)

    @property
    def checksum(self) -> int:
        return self.content.checksum if isinstance(self.content, Spool) else zlib.crc32(self.content)

    def pieces(self) -> Iterable[bytes]:
        return self.content.pieces() if isinstance(self.content, Spool) else (self.content,)


def write_container(path: Path, sections: Sequence[Section], *, overwrite: bool = True) -> dict[str, int]:
    """Write a whole file, or nothing.

    Returns
    -------
    dict of str to int
        Bytes of each section, and of header and table as ``"container"``; the sum is the file.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    with whole_file(path, overwrite=overwrite) as partial, partial.open("wb") as file:
        for piece in container_pieces(sections):
            file.write(piece)
    return section_sizes(sections)


def container_pieces(sections: Sequence[Section]) -> Iterator[bytes]:
    """The bytes of a file, a piece at a time: header, table, sections."""
    table = b"".join(_rows(sections))
    unsealed = HEADER.pack(IDENTIFIER, MAJOR_VERSION, MINOR_VERSION, len(sections), zlib.crc32(table), 0)[:-4]
    yield unsealed + CHECKSUM.pack(zlib.crc32(unsealed))
    yield table
    for section in sections:
        yield from section.pieces()


def _rows(sections: Sequence[Section]) -> Iterator[bytes]:
    """Rows of the table of sections."""
    for section in sections:
        size = (section.length.bit_length() + 7) // 8
        flags = (REQUIRED if section.required else 0) | size << LENGTH_AT
        length = section.length.to_bytes(size, "little")
        yield ENTRY_HEAD.pack(section.type.encode("ascii"), flags) + length + CHECKSUM.pack(section.checksum)


def section_sizes(sections: Sequence[Section]) -> dict[str, int]:
    """Bytes of each section, and of header and table as ``"container"``."""
    return {
        "container": HEADER.size + sum(len(row) for row in _rows(sections)),
        **{section.type: section.length for section in sections},
    }


class ContainerReader:
    """Sections of an open file, each checked against its checksum when it is read.

    Parameters
    ----------
    file : BinaryIO
        Seekable.
    path : str
        For messages.

    Raises
    ------
    CorruptFileError
        If the file is not a `.pdeanim` file, of another major version, truncated, or its table is damaged.
    """

    def __init__(self, file: BinaryIO, path: str) -> None:
        self._file = file
        self.path = path
        self.file_bytes = file.seek(0, os.SEEK_END)
        self.entries = self._read_table()

    def _read_table(self) -> dict[str, SectionEntry]:
        self._file.seek(0)
        header = self._file.read(HEADER.size)
        if header[: len(IDENTIFIER)] != IDENTIFIER[: len(header)] or not header:
            raise CorruptFileError("not a .pdeanim file (its first bytes are others)", path=self.path, offset=0)
        if len(header) < HEADER.size:
            raise CorruptFileError("ends inside its header; get it again", path=self.path, offset=len(header))
        _, major, _, count, table_checksum, header_checksum = HEADER.unpack(header)
        if zlib.crc32(header[:-4]) != header_checksum:
            raise CorruptFileError("its header is damaged; get it again", path=self.path, offset=0)
        if major != MAJOR_VERSION:
            message = f"has format version {major}, this decoder reads version {MAJOR_VERSION}; update pdecodec"
            raise CorruptFileError(message, path=self.path)
        if count > MAX_SECTIONS:
            raise CorruptFileError(f"declares {count} sections, at most {MAX_SECTIONS} can be", path=self.path)
        table = [self._read_row() for _ in range(count)]
        if zlib.crc32(b"".join(table)) != table_checksum:
            raise CorruptFileError("its table of sections is damaged", path=self.path, offset=HEADER.size)
        entries: dict[str, SectionEntry] = {}
        expected = HEADER.size + sum(len(row) for row in table)
        for row in table:
            raw_type, flags = ENTRY_HEAD.unpack_from(row)
            offset, length = expected, int.from_bytes(row[ENTRY_HEAD.size : -CHECKSUM.size], "little")
            (checksum,) = CHECKSUM.unpack(row[-CHECKSUM.size :])
            kind = raw_type.decode("ascii", "backslashreplace")
            if kind == RUN_BEGINS and kind in entries:
                message = "has runs of frames of different connectivity, which this decoder does not read"
                raise CorruptFileError(f"{message}; update pdecodec", path=self.path, offset=offset)
            if kind in entries:
                raise CorruptFileError(f"section {kind} stands twice", path=self.path, offset=offset)
            expected = offset + length
            entries[kind] = SectionEntry(kind, bool(flags & REQUIRED), offset, length, checksum)
        if expected != self.file_bytes:
            what = "is truncated" if expected > self.file_bytes else "has bytes after its last section"
            message = f"{what}: {self.file_bytes} bytes where the table says {expected}; get it again"
            raise CorruptFileError(message, path=self.path, offset=min(expected, self.file_bytes))
        return entries

    def _read_row(self) -> bytes:
        """One row of the table of sections."""
        row = self._file.read(ENTRY_HEAD.size)
        size = row[-1] >> LENGTH_AT if row else 0
        needed = ENTRY_HEAD.size + size + CHECKSUM.size if size <= MOST_LENGTH_BYTES else 0
        row += self._file.read(max(needed - len(row), 0))
        if len(row) != needed:
            raise CorruptFileError("its table of sections is damaged", path=self.path, offset=HEADER.size)
        return row

    def check_known(self, known: frozenset[str]) -> None:
        """Refuse required sections outside `known`; ignorable ones are passed over."""
        for entry in self.entries.values():
            if entry.required and entry.type not in known:
                message = f"needs section {entry.type}, which this decoder does not know; update pdecodec"
                raise CorruptFileError(message, path=self.path, offset=entry.offset)

    def entry(self, kind: str) -> SectionEntry:
        """The table's row for section `kind`."""
        if kind not in self.entries:
            raise CorruptFileError(f"has no section {kind}; get it again", path=self.path)
        return self.entries[kind]

    def read(self, kind: str) -> bytes:
        """A whole section, checked."""
        entry = self.entry(kind)
        data = self.read_range(entry.offset, entry.length)
        if zlib.crc32(data) != entry.checksum:
            raise CorruptFileError(
                f"section {kind} is damaged; get the file again", path=self.path, offset=entry.offset
            )
        return data

    def read_range(self, offset: int, length: int) -> bytes:
        """Bytes of the file as they are; the caller checks them."""
        self._file.seek(offset)
        data = self._file.read(length)
        if len(data) < length:
            raise CorruptFileError("was shortened while it was read", path=self.path, offset=offset + len(data))
        return data

    def verify(self) -> None:
        """Check every section, unknown ones too, without holding more than a piece of it."""
        for entry in self.entries.values():
            checksum, left = 0, entry.length
            self._file.seek(entry.offset)
            while left:
                piece = self._file.read(min(left, COPY_BYTES))
                if not piece:
                    break
                checksum, left = zlib.crc32(piece, checksum), left - len(piece)
            if left or checksum != entry.checksum:
                raise CorruptFileError(f"section {entry.type} is damaged", path=self.path, offset=entry.offset)
