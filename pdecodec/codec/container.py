"""The container: identifier, header, table of sections, sections (``spec/pdeanim.md``, sections 1 to 3)."""

from __future__ import annotations

import io
import struct
import tempfile
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import BinaryIO, Literal, cast

from pdecodec.system.whole_output import whole_file, write_errors

IDENTIFIER = b"\x89PDEANIM\r\n\x1a\n"
"""Modelled on PNG's: a byte that is not ASCII, the name, and line ends that a transfer as text would change."""

MAJOR_VERSION, MINOR_VERSION = 1, 0

HEADER = struct.Struct("<12sHHIII")
"""Identifier, major and minor version, number of sections, CRC-32 of the table, CRC-32 of everything before."""

ENTRY_HEAD = struct.Struct("<4sB")
"""Type and flags of a table row; the flags hold the width of the length. Length and CRC-32 follow; sections are
contiguous.
"""

CHECKSUM = struct.Struct("<I")

LENGTH_WIDTH_SHIFT = 4
"""Bit position of the length's width in the flags."""

REQUIRED = 1
"""Section flag: a decoder that does not know this type must refuse the file."""


@dataclass(frozen=True)
class SectionKind:
    """A kind of section.

    Attributes
    ----------
    type : str
        Four ASCII letters.
    title : str
        Its content in words.
    of : {"file", "run", "group", "fields", "cells"}
        What has such a section: a file, a run of frames, each group of frames as a chunk, the fields of a run, or the
        cells of a run.
    is_required : bool
        Whether a decoder that does not know the type must refuse the file.
    is_constant : bool
        Whether its size does not grow with the motion, as fields' does not: rates in bits per vertex and frame leave
        it out.
    """

    type: str
    title: str
    of: Literal["file", "run", "group", "fields", "cells"]
    is_required: bool = True
    is_constant: bool = False


SCENE_SECTION = "SCEN"

SECTION_KINDS = {
    kind.type: kind
    for kind in (
        SectionKind("META", "remarks", "file", is_required=False),
        SectionKind("SEQN", "times and objects", "file"),
        SectionKind("RUNS", "runs of frames", "file"),
        SectionKind("RDAT", "data of runs", "file"),
        SectionKind("NAME", "names of objects", "run"),
        SectionKind("CONN", "connectivity", "run", is_constant=True),
        SectionKind("ORDR", "order of faces", "run", is_constant=True),
        SectionKind("REST", "reference frame", "run"),
        SectionKind("MODL", "model", "run"),
        SectionKind("GRUP", "groups of frames", "run"),
        SectionKind("TIME", "functions of time", "group"),
        SectionKind("COEF", "coefficients", "group"),
        SectionKind("CORR", "residuals", "group"),
        SectionKind("ATTR", "attributes", "run", is_constant=True),
        SectionKind("FLDS", "headers of fields", "fields", is_required=False, is_constant=True),
        SectionKind("FDAT", "values of fields", "fields", is_required=False, is_constant=True),
        SectionKind("RFLD", "fields of runs", "file", is_required=False, is_constant=True),
        SectionKind(SCENE_SECTION, "scene around the motion", "file", is_required=False, is_constant=True),
        SectionKind("SOLD", "cells", "cells", is_constant=True),
    )
}
"""Kinds by type, in the order of files, and of section RDAT for each run. A file of one run has the run's
sections in its own table and no NAME; a file of several runs has RUNS and RDAT.
"""

RUN_SECTIONS = tuple(kind.type for kind in SECTION_KINDS.values() if kind.of in ("run", "group"))
"""Sections of a run, in the order of section RUNS."""

FIELD_SECTIONS = ("FLDS", "FDAT", "RFLD")
"""Sections of fields. In a file of several runs, one FLDS and one FDAT hold the fields of all runs, run after
run; RFLD says where each run's part ends.
"""

BESIDE_MOTION = (*FIELD_SECTIONS, SCENE_SECTION)
"""Sections that ratios of the motion leave out."""

CHUNK_SECTIONS = tuple(kind.type for kind in SECTION_KINDS.values() if kind.of == "group")
"""Sections that consist of one chunk per group of frames, each with its own checksum. All sections before the
first of these are needed for any frame.
"""

CONSTANT_SECTIONS = frozenset(kind.type for kind in SECTION_KINDS.values() if kind.is_constant)

COPY_BLOCK_BYTES = 2**20
"""Bytes copied or checked together, so that memory does not grow with a section."""


SPOOL_MEMORY = 2**18
"""Largest size of a section that grows without an output file and is kept in memory [bytes]."""


class Spool:
    """A section that grows while frames stream by: an unnamed temporary file, next to `output` if that is given.

    If the system refuses a write, InputError names `output`, or else the temporary folder.
    """

    def __init__(self, output: Path | None) -> None:
        self._named = output or Path(tempfile.gettempdir())
        with write_errors(self._named):
            # Open until `close` is called. Files of several runs have many small spools without an output file.
            self._file = cast(
                BinaryIO,
                tempfile.SpooledTemporaryFile(SPOOL_MEMORY)  # noqa: SIM115
                if output is None
                else tempfile.TemporaryFile(dir=output.parent),  # noqa: SIM115
            )
        self.length = 0
        self.checksum = 0

    @property
    def file(self) -> BinaryIO:
        """The file; it is closed with the spool."""
        return self._file

    def append(self, data: bytes) -> None:
        with write_errors(self._named):
            self._file.write(data)
        self.length += len(data)
        self.checksum = zlib.crc32(data, self.checksum)

    def pieces(self, first: int = 0, end: int | None = None) -> Iterator[bytes]:
        """Yield the bytes from `first` up to `end`; after that, more bytes can be appended."""
        left = (self.length if end is None else end) - first
        with write_errors(self._named):
            self._file.seek(first)  # flushes buffered bytes
        while piece := self._file.read(min(left, COPY_BLOCK_BYTES)):
            left -= len(piece)
            yield piece
        self._file.seek(0, io.SEEK_END)

    def close(self) -> None:
        with suppress(OSError):  # the failed write was reported before
            self._file.close()


@dataclass(frozen=True)
class Section:
    """A section to be written.

    Attributes
    ----------
    type : str
        Four ASCII letters.
    content : bytes or Spool
    """

    type: str
    content: bytes | Spool

    @property
    def length(self) -> int:
        return self.content.length if isinstance(self.content, Spool) else len(self.content)

    @property
    def checksum(self) -> int:
        return self.content.checksum if isinstance(self.content, Spool) else zlib.crc32(self.content)

    def pieces(self) -> Iterable[bytes]:
        return self.content.pieces() if isinstance(self.content, Spool) else (self.content,)


@dataclass(frozen=True)
class StoredSection:
    """A section of a file: its place, and the CRC-32 of its bytes; None for sections of runs, which the core checks."""

    offset: int
    length: int
    checksum: int | None


def stored_sections(file: BinaryIO) -> list[tuple[str, StoredSection]]:
    """Return the table of sections of a file. The core must have opened the file before, which checks the table."""
    file.seek(0)
    count = HEADER.unpack(file.read(HEADER.size))[3]
    found = []
    for _ in range(count):
        kind, flags = ENTRY_HEAD.unpack(file.read(ENTRY_HEAD.size))
        length = int.from_bytes(file.read(flags >> LENGTH_WIDTH_SHIFT), "little")
        found.append((kind.decode("ascii", "backslashreplace"), length, *CHECKSUM.unpack(file.read(CHECKSUM.size))))
    ends = [*accumulate((length for _, length, _ in found), initial=file.tell())]
    return [
        (kind, StoredSection(offset, length, checksum))
        for offset, (kind, length, checksum) in zip(ends, found, strict=False)
    ]


def notices_of_unknown(types: Iterable[str]) -> tuple[str, ...]:
    """Return a notice about those of a file's sections that this version does not know; empty if it knows all."""
    unknown = ", ".join(name for name in types if name not in SECTION_KINDS)
    return (f"sections not kept: {unknown}; this version does not know them",) if unknown else ()


def before_groups(head: bytes) -> int:
    """Return the offset at which groups of frames begin, from the unchecked first bytes of a file; 0 if these
    bytes do not contain it.
    """
    if not head.startswith(IDENTIFIER):
        return 0
    try:
        sections = dict(stored_sections(io.BytesIO(head)))
    except struct.error:
        return 0
    first = sections.get(CHUNK_SECTIONS[0])
    return first.offset if first else 0


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
    """Yield the bytes of a file in pieces: header, table, sections."""
    table = b"".join(_rows(sections))
    unsealed = HEADER.pack(IDENTIFIER, MAJOR_VERSION, MINOR_VERSION, len(sections), zlib.crc32(table), 0)[:-4]
    yield unsealed + CHECKSUM.pack(zlib.crc32(unsealed))
    yield table
    for section in sections:
        yield from section.pieces()


def _rows(sections: Sequence[Section]) -> Iterator[bytes]:
    """Yield the rows of the table of sections."""
    for section in sections:
        size = (section.length.bit_length() + 7) // 8
        flags = (REQUIRED if SECTION_KINDS[section.type].is_required else 0) | size << LENGTH_WIDTH_SHIFT
        length = section.length.to_bytes(size, "little")
        yield ENTRY_HEAD.pack(section.type.encode("ascii"), flags) + length + CHECKSUM.pack(section.checksum)


def section_sizes(sections: Sequence[Section]) -> dict[str, int]:
    """Return the bytes of each section, and of header and table as ``"container"``."""
    return {
        "container": HEADER.size + sum(len(row) for row in _rows(sections)),
        **{section.type: section.length for section in sections},
    }
