"""Section 26 of the specification: SCEN, the scene around the motion."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

from spec.decoder.fields import Fields, decompress, require


@dataclass
class Scene:
    """The files of a scene, what is in them, and what is not."""

    family: str
    contents: list[tuple[str, int]]
    outside: list[str]
    streams: dict[str, bytes]


def read_scene(section: bytes) -> Scene | None:
    """26: read SCEN; None if there is none."""
    if not section:
        return None
    fields = Fields(section)
    family = read_text(fields)
    require(family, "a scene of no format")
    contents = [(read_text(fields), fields.count()) for _ in range(read_number(fields))]
    outside = [read_text(fields) for _ in range(read_number(fields))]
    count = read_number(fields)
    require(count, "a scene without streams")
    rows = [(read_name(fields), fields.count(), fields.count(), fields.u32()) for _ in range(count)]
    known: set[str] = set()
    for name, *_ in rows:
        folded = "".join(letter.lower() if letter.isascii() else letter for letter in name)
        require(folded not in known, "two streams of one name")
        known.add(folded)
    for name in known:
        parts = name.split("/")
        above = {"/".join(parts[:depth]) for depth in range(1, len(parts))}
        require(not above & known, "a stream whose name is a folder of another's")
    require(sum(size for _, size, _, _ in rows) <= 2**40, "streams of more than 2^40 bytes")
    streams = {}
    for name, size, length, checksum in rows:
        packed = fields.take(length)
        require(bool(size) == bool(length), "a stream of no bytes")
        streams[name] = decompress(packed, size) if size else b""
        require(len(streams[name]) == size, "a stream of another size")
        require(zlib.crc32(streams[name]) == checksum, "a stream is damaged")
    fields.finish()
    return Scene(family, contents, outside, streams)


def read_number(fields: Fields) -> int:
    """26: read the number of entries of a list."""
    number = fields.count()
    require(number <= 2**16, "a list that is too long")
    return number


def read_text(fields: Fields) -> str:
    """26: read a text."""
    length = fields.count()
    require(length <= 4096, "a text that is too long")
    try:
        text = fields.take(length).decode()
    except UnicodeDecodeError:
        text = "\0"
    require(not any(ord(letter) < 32 or 127 <= ord(letter) < 160 for letter in text), "a text that is none")
    return text


def read_name(fields: Fields) -> str:
    """26: read the name of a stream."""
    name = read_text(fields)
    require(len(name.encode()) <= 255, "a name that is too long")
    require(not set(name) & set('\\:*?"<>|'), "a name with a character that names do not have")
    for part in name.split("/"):
        require(part not in ("", ".", "..") and part[0] != " " and part[-1] not in " .", "a name that leads elsewhere")
    return name
