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

_INFO = b"_ai_AlembicVersion"
"""First key of the text that says who wrote a file and when."""


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


def replace_info(path: Path, text: bytes) -> None:
    """Replace the text by which a file that the library wrote says who wrote it, and when.

    The library itself always writes the present time.
    """
    with path.open("r+b") as file:
        (root,) = _numbers(file, _ROOT_PLACE, 1)
        (count,) = _numbers(file, root, 1)
        for index, child in enumerate(_numbers(file, root + 8, count)):
            if child & _IS_DATA and (place := child & ~_IS_DATA):
                (size,) = _numbers(file, place, 1)
                if size >= len(_INFO) and file.read(len(_INFO)) == _INFO:
                    # The new text has another length: it goes to the end. Without the old one, equal input gives equal
                    # bytes.
                    file.seek(place + 8)
                    file.write(bytes(size))
                    end = file.seek(0, 2)
                    file.write(struct.pack("<Q", len(text)) + text)
                    file.seek(root + 8 * (index + 1))
                    file.write(struct.pack("<Q", end | _IS_DATA))
                    return


def _numbers(file: IO[bytes], place: int, count: int) -> tuple[int, ...]:
    file.seek(place)
    return struct.unpack(f"<{count}Q", file.read(8 * count))
