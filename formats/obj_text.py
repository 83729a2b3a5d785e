"""One OBJ file read in full: its bytes made ready for the kernels, numbers, elements, and every other statement."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from pdecodec.errors import InputError
from pdecodec.formats.decimal_text import ByteArray, Int64Array, float32_of_token, parse_decimals
from pdecodec.formats.obj_kernels import (
    BAD_COORDINATES,
    BAD_INDEX,
    FINE,
    INDEX_OUTSIDE,
    TEXTURE_NUMBERS,
    TEXTURE_OUTSIDE,
    TOO_FEW_CORNERS,
    VERTEX_NUMBERS,
    ZERO_INDEX,
    count_statements,
    fill_statements,
)
from pdecodec.formats.registry import read_errors
from pdecodec.sequence import Float32Array, Int32Array

_CONTINUATION = re.compile(rb"\\[ \t]*\r?\n")
_TOKEN = re.compile(rb"[^ \t\r\n\v\f]*")
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"

_MESSAGES = {
    BAD_INDEX: "expected a vertex index, found {token!r}; correct or export it again",
    ZERO_INDEX: "index 0 in {token!r}; OBJ counts from 1, or back from -1",
    INDEX_OUTSIDE: "{token!r} refers to a vertex that is not there, the file has {vertices}; export it again",
    TEXTURE_OUTSIDE: "{token!r} refers to a texture vertex that is not there, the file has {textures}; export it again",
    TOO_FEW_CORNERS: "{token!r} has too few vertices; a face has 3 or more, a line 2 or more, a point 1 or more",
    BAD_COORDINATES: "{token!r} has an unusual count of numbers; v takes 3, 4, 6 or 7, vt takes 1 to 3",
}


@dataclass(frozen=True, eq=False)
class ObjText:
    """Text of one OBJ file that ends with a line feed and holds no line continuations.

    Parameters
    ----------
    path : pathlib.Path
    frame : int
    data : bytes
        The file with continuations and byte order mark blanked out, so that offsets stay those of the file.
    joined : tuple of int
        Offsets of the continuations, which were line breaks.
    """

    path: Path
    frame: int
    data: bytes
    joined: tuple[int, ...] = ()

    @cached_property
    def codes(self) -> ByteArray:
        """The same as a read-only uint8 array, for the kernels."""
        return np.frombuffer(self.data, np.uint8)

    def error(self, offset: int, message: str) -> InputError:
        """An error at a byte of this file, which names the line."""
        line = 1 + self.data.count(b"\n", 0, offset) + sum(place < offset for place in self.joined)
        return InputError(f"line {line}: {message}", path=self.path, frame=self.frame)

    def token(self, offset: int) -> str:
        """The token that starts at a byte, shortened for messages."""
        return self._token_bytes(offset)[:40].decode("utf-8", "replace")

    def line(self, offset: int) -> bytes:
        """What stands from a byte to the end of its line."""
        return self.data[offset : self.data.index(b"\n", offset)]

    def _token_bytes(self, offset: int) -> bytes:
        match = _TOKEN.match(self.data, offset)
        return match[0] if match else b""

    def parse(self, starts: Int64Array) -> Float32Array:
        """(...) float32: the numbers whose tokens start at bytes (...) int64; 0 where that is negative, for none.

        Raises
        ------
        InputError
            If one is not a number.
        """
        places = starts.reshape(-1)
        numbers = np.empty(places.size, np.float32)
        certain = np.empty(places.size, np.bool_)
        parse_decimals(self.codes, places, numbers, certain)
        for index in np.flatnonzero(~certain).tolist():
            offset = int(places[index])
            token = self._token_bytes(offset)
            value = float32_of_token(token)
            if value is None:
                found = repr(self.token(offset)) if token else "the end of the line"
                raise self.error(offset, f"expected a number, found {found}; correct or export it again")
            numbers[index] = value
        return numbers.reshape(starts.shape)


def read_text(path: Path, frame: int) -> ObjText:
    """Read an OBJ file; InputError where it cannot be read, is empty, or is not text."""
    with read_errors(path, frame=frame):
        data = path.read_bytes()
    if not data.strip():
        raise InputError("the file is empty; export it again", path=path, frame=frame)
    if b"\0" in data:
        message = "this is not OBJ text, it holds zero bytes; check the file"
        raise InputError(message, path=path, frame=frame, offset=data.index(b"\0"))
    if data.startswith(_BYTE_ORDER_MARK):
        data = b" " * len(_BYTE_ORDER_MARK) + data[len(_BYTE_ORDER_MARK) :]
    joined: list[int] = []
    if b"\\" in data:
        data = _join_lines(data, joined)
    return ObjText(path, frame, data if data.endswith(b"\n") else data + b"\n", tuple(joined))


def _join_lines(data: bytes, joined: list[int]) -> bytes:
    """Blank out continuations, except in comments, which may well end in a backslash (a path)."""
    text = bytearray(data)
    for match in _CONTINUATION.finditer(data):
        start_of_line = text.rfind(b"\n", 0, match.start()) + 1
        if not text[start_of_line : match.start()].lstrip().startswith(b"#"):
            text[match.start() : match.end()] = b" " * (match.end() - match.start())
            joined.append(match.start())
    return bytes(text)


@dataclass(frozen=True, eq=False)
class ObjScan:
    """What stands in one OBJ file, in file order.

    Parameters
    ----------
    text : ObjText
    vertex_numbers : (vertices, 3 or 7) float32
        Numbers of each ``v`` line; positions first.
    vertex_sizes : (vertices,) int32
        How many of them there were.
    texture_numbers : (texture vertices, 3) float32
    texture_size : int
        Most numbers on a ``vt`` line, 0 without any.
    normal_numbers : (normals, 3) float32
    element_kinds, element_sizes : (elements,) int32
    corners : (corners, 3) int32
        Vertex, texture vertex and normal of each corner of each element, from 0; -1 for none of the latter.
    others : (statements, 3) int64
        Byte, vertices before, elements before each other statement.
    """

    text: ObjText
    vertex_numbers: Float32Array
    vertex_sizes: Int32Array
    texture_numbers: Float32Array
    texture_size: int
    normal_numbers: Float32Array
    element_kinds: Int32Array
    element_sizes: Int32Array
    corners: Int32Array
    others: Int64Array


def scan(text: ObjText) -> ObjScan:
    """Read everything in an OBJ file.

    Raises
    ------
    InputError
        With file and line, if a number, an index or a count is wrong, or there is no vertex.
    """
    vertices, textures, normals, elements, corner_count, other_count, long_vertices = (
        int(count) for count in count_statements(text.codes)
    )
    if vertices == 0:
        message = "there are no vertices (v lines); is this an OBJ file?"
        raise InputError(message, path=text.path, frame=text.frame)
    vertex_starts = np.full((vertices, VERTEX_NUMBERS if long_vertices else 3), -1, np.int64)
    texture_starts = np.full((textures, TEXTURE_NUMBERS), -1, np.int64)
    vertex_sizes, texture_sizes = np.zeros(vertices, np.int32), np.zeros(textures, np.int32)
    element_kinds, element_sizes = np.zeros((2, elements), np.int32)
    normal_starts = np.full((normals, 3), -1, np.int64)
    corners = np.zeros((corner_count, 3), np.int32)
    others = np.zeros((other_count, 3), np.int64)
    outcome, offset = fill_statements(
        text.codes,
        vertex_starts,
        vertex_sizes,
        texture_starts,
        texture_sizes,
        normal_starts,
        element_kinds,
        element_sizes,
        corners,
        others,
    )
    if outcome != FINE:
        message = _MESSAGES[outcome].format(token=text.token(offset), vertices=vertices, textures=textures)
        raise text.error(offset, message)
    return ObjScan(
        text=text,
        vertex_numbers=text.parse(vertex_starts),
        vertex_sizes=vertex_sizes,
        texture_numbers=text.parse(texture_starts),
        texture_size=int(texture_sizes.max(initial=0)),
        normal_numbers=text.parse(normal_starts),
        element_kinds=element_kinds,
        element_sizes=element_sizes,
        corners=corners,
        others=others,
    )
