"""Take `.pdeanim` files apart and seal them again, so that damage gets past the checksums.

For tests and vectors. It uses the decoder of this folder and nothing of the library.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, replace
from unittest.mock import patch

import zstandard

from spec.decoder import contexts
from spec.decoder.animation import decode
from spec.decoder.fields import IDENTIFIER, MAJOR_VERSION, OF_RUN, CorruptFileError, Fields
from spec.decoder.groups import CLOSED_FORM, PRECISE, SHAPES, TRAJECTORIES
from spec.decoder.rangecoder import FIRST_BYTES, MAX_WIDTH, MIN_WIDTH, WORD_BYTES, RangeDecoder

HEADER = struct.Struct("<12sHHIII")
CHUNKS = ("TIME", "COEF", "CORR")
"""Sections that are divided into chunks of groups."""

REQUIRED = 1
FRAME_MAGIC = b"\x28\xb5\x2f\xfd"


@dataclass(frozen=True)
class Part:
    """One section of a file."""

    kind: str
    content: bytes
    flags: int = REQUIRED
    length_bytes: int = 0
    """Bytes of its length at least; further ones than needed are zeros."""

    @property
    def row(self) -> bytes:
        """Its row in the table of sections."""
        size = max((len(self.content).bit_length() + 7) // 8, self.length_bytes)
        head = self.kind.encode("latin-1") + bytes([self.flags | size << 4])
        return head + len(self.content).to_bytes(size, "little") + struct.pack("<I", zlib.crc32(self.content))


def take_apart(data: bytes) -> list[Part]:
    """Return the sections of a valid file, in order."""
    count = HEADER.unpack_from(data)[3]
    rows, at = [], HEADER.size
    for _ in range(count):
        size = data[at + 4] >> 4
        length = int.from_bytes(data[at + 5 : at + 5 + size], "little")
        rows.append((data[at : at + 4].decode("latin-1"), data[at + 4] & 15, length))
        at += 9 + size
    parts = []
    for kind, flags, length in rows:
        parts.append(Part(kind, data[at : at + length], flags))
        at += length
    return parts


def table_end(parts: list[Part]) -> int:
    """Return where the table of these sections ends [bytes]."""
    return HEADER.size + sum(len(part.row) for part in parts)


def seal(parts: list[Part], *, major: int = MAJOR_VERSION, minor: int = 0) -> bytes:
    """Build a file from sections, with valid checksums."""
    table = b"".join(part.row for part in parts)
    header = HEADER.pack(IDENTIFIER, major, minor, len(parts), zlib.crc32(table), 0)[:-4]
    return header + struct.pack("<I", zlib.crc32(header)) + table + b"".join(part.content for part in parts)


def content(parts: list[Part], kind: str) -> bytes:
    """Return the bytes of one section."""
    return next(part.content for part in parts if part.kind == kind)


def count(number: int) -> bytes:
    """Encode a count: 7 bits per byte, lowest bits first."""
    more = number >> 7
    return bytes([number & 127 | 128]) + count(more) if more else bytes([number])


@dataclass(frozen=True)
class Row:
    """A row of section GRUP. Steps and alpha stay bytes, so that the bits of a NaN survive."""

    frames: int
    functions: int
    kind: int
    reals: bytes
    sizes: tuple[int, int, int]
    checksum: int = 0

    @staticmethod
    def has_time(kind: int) -> bool:
        return kind & ~PRECISE in (TRAJECTORIES, SHAPES)

    def pack(self) -> bytes:
        """Return its bytes."""
        sizes = self.sizes if self.has_time(self.kind) else self.sizes[1:]
        head = count(self.frames) + count(self.functions) + bytes([self.kind]) + self.reals
        return head + b"".join(map(count, sizes)) + struct.pack("<I", self.checksum)


def take_rows(table: bytes) -> tuple[list[Row], bytes]:
    """Return the complete rows of section GRUP, and the bytes after them."""
    rows: list[Row] = []

    def take_count(at: int) -> tuple[int, int]:
        end = next(place for place in range(at, len(table)) if table[place] < 128) + 1
        return sum((byte & 127) << 7 * place for place, byte in enumerate(table[at:end])), end

    at = 0
    while True:
        try:
            frames, here = take_count(at)
            functions, here = take_count(here)
            kind = table[here]
            reals = 8 + 8 * (Row.has_time(kind) or kind & ~PRECISE == CLOSED_FORM)
            sizes, here = [0] * (not Row.has_time(kind)), here + 1 + reals
            while len(sizes) < 3:
                size, here = take_count(here)
                sizes.append(size)
            (checksum,) = struct.unpack_from("<I", table, here)
        except (StopIteration, IndexError, struct.error):
            return rows, table[at:]
        reals_end = here - sum(len(count(size)) for size in sizes[not Row.has_time(kind) :])
        rows.append(Row(frames, functions, kind, table[reals_end - reals : reals_end], tuple(sizes), checksum))
        at = here + 4


@dataclass(frozen=True)
class RunParts:
    """One run in a file of runs: its sections; None for sections that equal those of the previous run."""

    vertices: int
    sections: dict[str, bytes | None]

    def row(self, checksums: dict[str, int] | None = None) -> bytes:
        """Return its row of RUNS, with wrong checksums if some are given."""
        packed = count(self.vertices)
        for kind, section in self.sections.items():
            packed += b"\0" if section is None else count(len(section) + 1)
            if section and kind not in CHUNKS:
                packed += struct.pack("<I", (checksums or {}).get(kind, zlib.crc32(section)))
        return packed

    @property
    def data(self) -> bytes:
        """Return its bytes in RDAT."""
        return b"".join(section for section in self.sections.values() if section is not None)


def run_of(parts: list[Part], names: bytes, vertices: int) -> RunParts:
    """Convert the sections of a file of one run to a run, with coded names."""
    found = {part.kind: part.content for part in parts} | {"NAME": names}
    return RunParts(vertices, {kind: found.get(kind, b"") for kind in OF_RUN})


def take_runs(parts: list[Part]) -> list[RunParts]:
    """Return the runs of a valid file of runs."""
    table, data, runs = Fields(content(parts, "RUNS")), Fields(content(parts, "RDAT")), []
    for _ in range(Fields(content(parts, "SEQN")).count()):
        vertices, sections = table.count(), {}
        for kind in OF_RUN:
            size = table.count()
            sections[kind] = data.take(size - 1) if size else None
            if size > 1 and kind not in CHUNKS:
                table.u32()
        runs.append(RunParts(vertices, sections))
    return runs


def with_runs(parts: list[Part], runs: list[RunParts]) -> list[Part]:
    """Return the sections of a file of runs with its runs replaced."""
    new = {"RUNS": b"".join(run.row() for run in runs), "RDAT": b"".join(run.data for run in runs)}
    return [replace(part, content=new.get(part.kind, part.content)) for part in parts]


def with_section(parts: list[Part], kind: str, new: bytes, *, sizes: list[int] | None = None) -> list[Part]:
    """Return sections in which one has new content, with valid checksums of groups.

    `sizes` are the sizes of the groups' chunks in this section (TIME, COEF or CORR), if they change.
    """
    changed = {part.kind: part.content for part in parts} | {kind: new}
    rows, left = take_rows(changed["GRUP"])
    sealed, at = b"", [0, 0, 0]
    for number, row in enumerate(rows):
        lengths = list(row.sizes)
        if sizes is not None:
            lengths[CHUNKS.index(kind)] = sizes[number]
        checksum = 0
        for index, name in enumerate(CHUNKS):
            checksum = zlib.crc32(changed[name][at[index] : at[index] + lengths[index]], checksum)
            at[index] += lengths[index]
        sealed += replace(row, sizes=(lengths[0], lengths[1], lengths[2]), checksum=checksum).pack()
    changed["GRUP"] = sealed + left
    return [replace(part, content=changed[part.kind]) for part in parts]


def group_chunks(parts: list[Part], kind: str) -> list[bytes]:
    """Return the chunk of each group in TIME, COEF or CORR."""
    chunks, at = [], 0
    for row in take_rows(content(parts, "GRUP"))[0]:
        size = row.sizes[CHUNKS.index(kind)]
        chunks.append(content(parts, kind)[at : at + size])
        at += size
    return chunks


def with_first_group(parts: list[Part], kind: str, chunk: bytes) -> list[Part]:
    """Return sections with the first group's chunk of TIME, COEF or CORR replaced."""
    chunks = [chunk, *group_chunks(parts, kind)[1:]]
    return with_section(parts, kind, b"".join(chunks), sizes=[len(each) for each in chunks])


class EndOfScriptError(Exception):
    """The decoder asks for more bits than the script has."""


class ScriptedCoder(RangeDecoder):
    """Replaces a range decoder: returns the bits of a script, and encodes them."""

    def __init__(self, bits: str) -> None:
        super().__init__(b"")
        self.bits = iter(bits)
        self._low, self._interval, self._written = 0, MAX_WIDTH, 0

    def bit_with(self, probability: int) -> int:
        split = (self._interval >> 16) * probability
        bit = next(self.bits, "")
        if not bit:
            raise EndOfScriptError
        self._low += 0 if bit == "1" else split
        self._interval = split if bit == "1" else self._interval - split
        if self._interval < MIN_WIDTH:
            self._low, self._interval = self._low << 8 * WORD_BYTES, self._interval << 8 * WORD_BYTES
            self._written += WORD_BYTES
        return int(bit)

    def is_finished(self) -> bool:
        return True

    def has_ended(self) -> bool:
        return False

    def to_bytes(self) -> bytes:
        """Return the shortest bytes that decode to the same bits."""
        sizes = range(self._written, self._written + FIRST_BYTES + 1)
        units = [256 ** (sizes[-1] - size) for size in sizes]
        size, unit = next((s, u) for s, u in zip(sizes, units, strict=True) if -self._low % u < self._interval)
        return (-(-self._low // unit)).to_bytes(size, "big")


def scripted(
    parts: list[Part], kind: str, bits: str, *, head: bytes = b"", group: bool = False, says: str = ""
) -> list[Part]:
    """Return sections with a coded stream whose bits, in the order in which the decoder reads them, come from a script.

    The stream follows `head` in section `kind`, or in the first group's chunk of it if `group` is set. If `says` is
    given, the decoder must refuse the file with this message exactly at the last bit.
    """
    marker = b"the script"
    coder = ScriptedCoder(bits.replace(" ", ""))
    change = with_first_group if group else with_section

    def coder_of(data: bytes) -> RangeDecoder:
        return coder if data == marker else RangeDecoder(data)

    said = ""
    with patch.object(contexts, "RangeDecoder", coder_of):
        try:
            animation = decode(seal(change(parts, kind, head + marker)))
            animation.positions(animation.times[0])
        except EndOfScriptError:
            pass
        except CorruptFileError as error:
            said = str(error)
    if says and (said != says or next(coder.bits, "")):
        raise AssertionError(f"the decoder says {said!r}, not {says!r}, or does so too early")
    return change(parts, kind, head + coder.to_bytes())


def counted(number: int, most: int | None = None) -> str:
    """Return the bits of a number of 1 or more with at most `most` digits: its length, then the digits below
    the first (3.6).
    """
    digits = number.bit_length()
    return "1" * (digits - 1) + ("" if digits == most else "0") + f"{number:b}"[1:]


def numbers(*values: int) -> str:
    """Return the bits of numbers of 0 or more (3.6)."""
    return "".join(counted(value + 1, contexts.MAX_DIGITS) for value in values)


def text(characters: bytes) -> str:
    """Return the bits of a text (3.9)."""
    return "".join(f"{byte:08b}" for byte in characters + b"\xff")


def sequence(
    frames: int, *, rule: int = 0, runs: int = 1, flags: int = 0, fps: bytes = b"\x18", times: bytes = b"\0"
) -> bytes:
    """Return section SEQN without its coded stream: 24 frames per second, starting at 0 s."""
    return count(runs) + count(frames) + bytes([rule | flags]) + fps + times


def compressed(data: bytes) -> bytes:
    """Compress data to a Zstandard frame that declares its size."""
    return zstandard.ZstdCompressor(level=1, write_content_size=True).compress(data) if data else b""


def zeros(declared: int, blocks: int) -> bytes:
    """Return a frame of `blocks` times 128 KiB of zeros that declares another size; each block takes four bytes."""
    block = struct.pack("<I", (2**17 << 3) | 2)[:3] + b"\0"
    last = struct.pack("<I", (2**17 << 3) | 3)[:3] + b"\0"
    return FRAME_MAGIC + b"\xc0\x38" + struct.pack("<Q", declared) + block * (blocks - 1) + last
