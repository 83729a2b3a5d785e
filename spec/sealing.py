"""Taking `.pdeanim` files apart and sealing them again, so that damage gets past the checksums.

For tests and vectors. Written from ``spec/pdeanim.md`` alone, with nothing of the library in it.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, replace

import zstandard

IDENTIFIER = b"\x89PDEANIM\r\n\x1a\n"
HEADER = struct.Struct("<12sHHIII")
ENTRY_1 = struct.Struct("<4sIQQII")
SEGMENT = struct.Struct("<IfhHIII")
GROUP = struct.Struct("<IIBddIIII")
CHUNKS = ("TIME", "COEF", "CORR")
"""Sections that are the chunks of groups."""

REQUIRED = 1
FRAME_MAGIC = b"\x28\xb5\x2f\xfd"


@dataclass(frozen=True)
class Part:
    """One section of a file."""

    kind: str
    content: bytes
    flags: int = REQUIRED


def take_apart(data: bytes) -> list[Part]:
    """The sections of a sound file, in order."""
    _, major, _, count, _, _ = HEADER.unpack_from(data)
    parts = []
    rows, at = [], HEADER.size
    for _ in range(count):
        kind, flags = data[at : at + 4].decode("latin-1"), data[at + 4]
        if major == 1:
            rows.append((kind, flags, ENTRY_1.unpack_from(data, at)[3]))
            at += ENTRY_1.size
        else:
            size = flags >> 4
            rows.append((kind, flags & 15, int.from_bytes(data[at + 5 : at + 5 + size], "little")))
            at += 9 + size
    for kind, flags, length in rows:
        parts.append(Part(kind, data[at : at + length], flags))
        at += length
    return parts


def row_of_version_2(part: Part) -> bytes:
    """A row of the table of sections."""
    size = (len(part.content).bit_length() + 7) // 8
    head = part.kind.encode("latin-1") + bytes([part.flags | size << 4])
    return head + len(part.content).to_bytes(size, "little") + struct.pack("<I", zlib.crc32(part.content))


def table_end(parts: list[Part], major: int) -> int:
    """Where the table of these sections ends."""
    rows = (ENTRY_1.size if major == 1 else len(row_of_version_2(part)) for part in parts)
    return HEADER.size + sum(rows)


def seal(parts: list[Part], *, major: int = 1, minor: int = 0) -> bytes:
    """A file of these sections, every checksum right."""
    offset = table_end(parts, major)
    table = b""
    for part in parts:
        if major == 1:
            kind, length, checksum = part.kind.encode("latin-1"), len(part.content), zlib.crc32(part.content)
            table += ENTRY_1.pack(kind, part.flags, offset, length, checksum, 0)
        else:
            table += row_of_version_2(part)
        offset += len(part.content)
    header = HEADER.pack(IDENTIFIER, major, minor, len(parts), zlib.crc32(table), 0)[:-4]
    return header + struct.pack("<I", zlib.crc32(header)) + table + b"".join(part.content for part in parts)


def content(parts: list[Part], kind: str) -> bytes:
    """The bytes of one section."""
    return next(part.content for part in parts if part.kind == kind)


def with_section(parts: list[Part], kind: str, new: bytes) -> list[Part]:
    """The same sections, one of them with other bytes; the segments' own checksums are made right."""
    changed = [replace(part, content=new) if part.kind == kind else part for part in parts]
    return _seal_segments(changed) if kind in ("SEGM", "COEF", "CORR") else changed


def with_chunk(parts: list[Part], kind: str, chunk: bytes) -> list[Part]:
    """The first segment's part of COEF or CORR replaced, and the segment table made to say so."""
    column = {"COEF": 4, "CORR": 5}[kind]
    table = content(parts, "SEGM")
    row = list(SEGMENT.unpack_from(table))
    rest = content(parts, kind)[row[column] :]
    row[column] = len(chunk)
    return with_section(with_section(parts, kind, chunk + rest), "SEGM", SEGMENT.pack(*row) + table[SEGMENT.size :])


def with_group_section(parts: list[Part], kind: str, new: bytes, *, sizes: list[int] | None = None) -> list[Part]:
    """The same sections of a file of version 2, one of them with other bytes; the groups' checksums are made right.

    `sizes` are what each group has of TIME, COEF or CORR, where that changes.
    """
    changed = {part.kind: part.content for part in parts} | {kind: new}
    table, sealed, at = changed["GRUP"], b"", [0, 0, 0]
    for row, offset in enumerate(range(0, len(table) - GROUP.size + 1, GROUP.size)):
        lengths = list(struct.unpack_from("<III", table, offset + GROUP.size - 16))
        if sizes is not None:
            lengths[CHUNKS.index(kind)] = sizes[row]
        checksum = 0
        for index, name in enumerate(CHUNKS):
            checksum = zlib.crc32(changed[name][at[index] : at[index] + lengths[index]], checksum)
            at[index] += lengths[index]
        # Packed as bytes: a step may be a NaN whose bits must stay.
        sealed += table[offset : offset + GROUP.size - 16] + struct.pack("<IIII", *lengths, checksum)
    changed["GRUP"] = sealed + table[len(sealed) :]
    return [replace(part, content=changed[part.kind]) for part in parts]


def group_chunks(parts: list[Part], kind: str) -> list[bytes]:
    """What each group has of TIME, COEF or CORR."""
    chunks, at = [], 0
    for row in GROUP.iter_unpack(content(parts, "GRUP")):
        size = row[5 + CHUNKS.index(kind)]
        chunks.append(content(parts, kind)[at : at + size])
        at += size
    return chunks


def with_first_group(parts: list[Part], kind: str, chunk: bytes) -> list[Part]:
    """The same sections, another chunk of TIME, COEF or CORR for the first group."""
    chunks = [chunk, *group_chunks(parts, kind)[1:]]
    return with_group_section(parts, kind, b"".join(chunks), sizes=[len(each) for each in chunks])


def count(number: int) -> bytes:
    """A count: 7 bits a byte, low bits first."""
    more = number >> 7
    return bytes([number & 127 | 128]) + count(more) if more else bytes([number])


def even_bits(bits: str) -> bytes:
    """A coded stream of bits of probability one half: the binary digits of a fraction, 0 for 1 and 1 for 0.

    Cells and mixes that nothing was learnt from give that probability. So this is the beginning of most streams.
    """
    digits = "".join("10"[bit == "1"] for bit in bits if bit != " ")
    written = bytes(int(digits[at : at + 8].ljust(8, "0"), 2) for at in range(0, len(digits), 8))
    return written[:-1] if written.endswith(b"\0") else written


def counted(number: int) -> str:
    """Bits of a number from 1 on as section 27 writes it: how many digits it has, then those below the first."""
    return "1" * (number.bit_length() - 1) + "0" + f"{number:b}"[1:]


def _seal_segments(parts: list[Part]) -> list[Part]:
    table, at, sealed = content(parts, "SEGM"), {"COEF": 0, "CORR": 0}, b""
    for offset in range(0, len(table) - SEGMENT.size + 1, SEGMENT.size):
        coefficient_bytes, correction_bytes, _ = SEGMENT.unpack_from(table, offset)[4:]
        checksum = 0
        for kind, size in (("COEF", coefficient_bytes), ("CORR", correction_bytes)):
            checksum = zlib.crc32(content(parts, kind)[at[kind] : at[kind] + size], checksum)
            at[kind] += size
        # Packed as bytes: alpha may be a NaN whose bits must stay.
        sealed += table[offset : offset + 20] + struct.pack("<I", checksum)
    sealed += table[len(sealed) :]
    return [replace(part, content=sealed) if part.kind == "SEGM" else part for part in parts]


def sized(data: bytes) -> bytes:
    """A byte string after its length."""
    return struct.pack("<Q", len(data)) + data


def compressed(data: bytes) -> bytes:
    """A zstandard frame that declares its size."""
    return zstandard.ZstdCompressor(level=1, write_content_size=True).compress(data) if data else b""


def varints(*values: int) -> bytes:
    """Integers as zigzag variable-length integers."""
    out = bytearray()
    for value in values:
        rest = 2 * value if value >= 0 else -2 * value - 1
        while rest >= 128:
            out.append(rest & 127 | 128)
            rest >>= 7
        out.append(rest)
    return bytes(out)


def integers(*values: int) -> bytes:
    """A sized stream of integers."""
    return sized(compressed(varints(*values)))


def zeros(declared: int, blocks: int) -> bytes:
    """A frame of `blocks` times 128 KiB of zeros that declares another size: four bytes a block."""
    block = struct.pack("<I", (2**17 << 3) | 2)[:3] + b"\0"
    last = struct.pack("<I", (2**17 << 3) | 3)[:3] + b"\0"
    return FRAME_MAGIC + b"\xc0\x38" + struct.pack("<Q", declared) + block * (blocks - 1) + last


def streams(data: bytes) -> list[tuple[int, int]]:
    """Where the sized streams of a section begin, and how long they are; those that can be unpacked."""
    found, at = [], data.find(FRAME_MAGIC)
    while at >= 0:
        (size,) = struct.unpack_from("<Q", data, at - 8) if at >= 8 else (len(data) + 1,)
        if size <= len(data) - at:
            try:
                unpacked(data, (at, size))
                found.append((at, size))
            except zstandard.ZstdError:
                pass
        at = data.find(FRAME_MAGIC, at + 4)
    return found


def unpacked(data: bytes, stream: tuple[int, int]) -> bytes:
    """What one of :func:`streams` holds."""
    at, size = stream
    return zstandard.ZstdDecompressor().decompress(data[at : at + size])


def with_stream(data: bytes, stream: tuple[int, int], new: bytes) -> bytes:
    """A section with the content of one of :func:`streams` replaced, its length made right."""
    at, size = stream
    return data[: at - 8] + sized(compressed(new)) + data[at + size :]


def split_integers(stream: bytes) -> list[bytes]:
    """The bytes of each integer of a stream; what is no whole integer at its end comes last."""
    values, begin = [], 0
    for at, byte in enumerate(stream):
        if byte < 128:
            values.append(stream[begin : at + 1])
            begin = at + 1
    return [*values, stream[begin:]] if begin < len(stream) else values
