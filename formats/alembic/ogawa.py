"""The layout of Alembic's files: a tree of groups whose leaves are blocks.

Blocks are the samples of properties, each after a key of 16 bytes, and texts. A group is its number of children and the
place of each; a block its size and its content.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from pdecodec.errors import damaged

KEY_BYTES = 16
"""Bytes of a sample's key."""

_ROOT_PLACE, _IS_DATA = 8, 1 << 63
"""Place of the root group's place; bit of a place that says that there is a block."""

_INFO_CHILD = 3
"""Number of the root group's child that is a text: who wrote the file, and when."""


def blocks(data: bytearray) -> Iterator[tuple[int, int]]:
    """Yield the place and size of the content of each sample; damaged if the tree is none."""
    left, seen = [_number(data, _ROOT_PLACE)], set[int]()
    while left:
        place = left.pop()
        if place in seen or not place:
            continue
        seen.add(place)
        for index in range(_number(data, place)):
            child = _number(data, place + 8 * (index + 1))
            if not child & _IS_DATA:
                left.append(child)
                continue
            where = child & ~_IS_DATA
            if where and where not in seen:
                seen.add(where)
                size = _number(data, where)
                if where + 8 + size > len(data):
                    raise damaged("its tree of blocks leaves the file")
                if size > KEY_BYTES:
                    yield where + 8 + KEY_BYTES, size - KEY_BYTES


def _number(data: bytearray, place: int) -> int:
    if place + 8 > len(data):
        raise damaged("its tree of blocks leaves the file")
    (found,) = struct.unpack_from("<Q", data, place)
    return int(found)


def read_info(path: Path) -> bytes:
    """Return the text in which a file states who wrote it, and when."""
    with path.open("rb") as file:
        _, place, size = _find_info(file)
        file.seek(place)
        return file.read(size)


def replace_info(path: Path, text: bytes) -> None:
    """Replace the text in which a file states who wrote it, and when: the library always writes the present time."""
    with path.open("r+b") as file:
        reference, place, size = _find_info(file)
        # The new text has another length: it goes to the end. Without the old one, equal input gives equal bytes.
        file.seek(place)
        file.write(bytes(size))
        end = file.seek(0, 2)
        file.write(struct.pack("<Q", len(text)) + text)
        file.seek(reference)
        file.write(struct.pack("<Q", end | _IS_DATA))


def _find_info(file: IO[bytes]) -> tuple[int, int, int]:
    """Return the place of the reference to a file's text about itself, and the place and size of that text."""
    end = file.seek(0, 2)
    reference = _number_at(file, _ROOT_PLACE) + 8 * (_INFO_CHILD + 1)
    where = _number_at(file, reference) & ~_IS_DATA
    size = _number_at(file, where) if where else 0
    if where + 8 + size > end:
        raise damaged("its tree of blocks leaves the file")
    return reference, where + 8, size


def _number_at(file: IO[bytes], place: int) -> int:
    file.seek(min(place, _IS_DATA - 1))
    return _number(bytearray(file.read(8)), 0)
