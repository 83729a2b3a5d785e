"""Compiled passes over the bytes of an OBJ file.

A file is read in full once, for frame 0: :func:`count_statements` sizes the arrays, :func:`fill_statements`
fills them. Later frames of the same structure take one pass, :func:`find_positions`, which compares every line
but the numbers with the structure that :func:`copy_structure` kept. Numbers are found here, and parsed all at
once by :func:`pdecodec.formats.decimal_text.parse_decimals`.

All kernels take text that ends with a line feed and holds no line continuations (:mod:`pdecodec.formats.obj_text`).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pdecodec.formats.decimal_text import ByteArray, Int64Array, is_blank
from pdecodec.sequence import Int32Array

OTHER, VERTEX, TEXTURE, NORMAL, FACE, LINE, POINT, LIBRARY, NOTHING = range(9)
"""Kinds of lines; LIBRARY is ``mtllib``, NOTHING a blank line or a comment."""

FINE, BAD_INDEX, ZERO_INDEX, INDEX_OUTSIDE, TEXTURE_OUTSIDE, TOO_FEW_CORNERS, BAD_COORDINATES = range(7)
"""Outcomes of :func:`fill_statements`."""

MAX_INDEX_DIGITS = 10
"""2^31 has ten digits; longer indices are refused before they overflow."""

VERTEX_NUMBERS = 7
"""Numbers on a ``v`` line: x y z, then w, or r g b, or r g b a."""

TEXTURE_NUMBERS = 3
"""Numbers on a ``vt`` line: u, v and w."""


@njit(cache=True, nogil=True)
def _skip_blanks(text: ByteArray, at: int) -> int:
    while is_blank(text[at]):
        at += 1
    return at


@njit(cache=True, nogil=True)
def _skip_token(text: ByteArray, at: int) -> int:
    while text[at] != 10 and not is_blank(text[at]):
        at += 1
    return at


@njit(cache=True, nogil=True)
def _next_line(text: ByteArray, at: int) -> int:
    while text[at] != 10:
        at += 1
    return at + 1


@njit(cache=True, nogil=True)
def _at_end(byte: int) -> bool:
    """Whether a line's tokens end here: at a line feed or a comment."""
    return byte == 10 or byte == 35


@njit(cache=True, nogil=True)
def _kind_of(first: int, second: int, third: int) -> int:
    """Kind of a line that starts with these three bytes, those after its line feed standing for anything."""
    if _at_end(first):
        return NOTHING
    if is_blank(second) or second == 10:
        if first == 118:
            return VERTEX
        if first == 102:
            return FACE
        if first == 108:
            return LINE
        if first == 112:
            return POINT
    elif first == 118 and (is_blank(third) or third == 10):
        if second == 116:
            return TEXTURE
        if second == 110:
            return NORMAL
    elif first == 109 and second == 116:
        return LIBRARY
    return OTHER


@njit(cache=True, nogil=True)
def _line_kind(text: ByteArray, at: int) -> int:
    """Kind of the line whose first token starts at `at`."""
    last = text.size - 1
    return _kind_of(text[at], text[min(at + 1, last)], text[min(at + 2, last)])


@njit(cache=True, nogil=True)
def _count_tokens(text: ByteArray, at: int) -> int:
    count = 0
    at = _skip_blanks(text, at)
    while not _at_end(text[at]):
        count += 1
        at = _skip_blanks(text, _skip_token(text, at))
    return count


@njit(cache=True, nogil=True)
def count_statements(text: ByteArray) -> Int64Array:
    """How many vertices, texture vertices, normals, elements, corners of elements and other statements a file holds.

    The seventh is that of vertices with more than three numbers. A point statement is as many elements as points.
    """
    counts = np.zeros(7, np.int64)
    at = 0
    while at < text.size:
        at = _skip_blanks(text, at)
        kind = _line_kind(text, at)
        if kind == VERTEX:
            counts[0] += 1
            counts[6] += _count_tokens(text, at) > 4
        elif kind == TEXTURE:
            counts[1] += 1
        elif kind == NORMAL:
            counts[2] += 1
        elif kind in (FACE, LINE):
            counts[3] += 1
            counts[4] += _count_tokens(text, at) - 1
        elif kind == POINT:
            tokens = _count_tokens(text, at) - 1
            counts[3] += tokens
            counts[4] += tokens
        elif kind in (OTHER, LIBRARY):
            counts[5] += 1
        at = _next_line(text, at)
    return counts


@njit(cache=True, nogil=True)
def _find_numbers(text: ByteArray, at: int, starts: Int64Array, row: int) -> int:
    """Note where the tokens of one line start, as many as `starts` has columns; return how many there are."""
    count = 0
    at = _skip_blanks(text, at)
    while not _at_end(text[at]):
        if count < starts.shape[1]:
            starts[row, count] = at
        count += 1
        at = _skip_blanks(text, _skip_token(text, at))
    return count


@njit(cache=True, nogil=True)
def _parse_index(text: ByteArray, at: int) -> tuple[int, int, bool]:
    """An index as written, where it ends, and whether it is one."""
    negative = text[at] == 45
    if negative:
        at += 1
    value = 0
    digits = 0
    while 48 <= text[at] <= 57 and digits <= MAX_INDEX_DIGITS:
        value = value * 10 + (text[at] - 48)
        digits += 1
        at += 1
    return (-value if negative else value), at, 0 < digits <= MAX_INDEX_DIGITS


@njit(cache=True, nogil=True)
def _parse_corner(
    text: ByteArray, at: int, vertices_before: int, textures_before: int, normals_before: int
) -> tuple[int, int, int, int, int]:
    """One ``v``, ``v/vt``, ``v//vn`` or ``v/vt/vn``: 0-based vertex, texture vertex and normal, end, outcome.

    Texture vertex and normal are -1 for none; a normal is not looked for.
    """
    texture = -1
    normal = -1
    vertex, at, good = _parse_index(text, at)
    if not good:
        return 0, 0, 0, at, BAD_INDEX
    if vertex == 0:
        return 0, 0, 0, at, ZERO_INDEX
    vertex = vertex - 1 if vertex > 0 else vertices_before + vertex
    if text[at] == 47:
        at += 1
        if 48 <= text[at] <= 57 or text[at] == 45:
            texture, at, good = _parse_index(text, at)
            if not good:
                return 0, 0, 0, at, BAD_INDEX
            if texture == 0:
                return 0, 0, 0, at, ZERO_INDEX
            texture = texture - 1 if texture > 0 else textures_before + texture
            if texture < 0:
                return 0, 0, 0, at, TEXTURE_OUTSIDE
        if text[at] == 47:
            at += 1
            if text[at] != 10 and not is_blank(text[at]):
                normal, at, good = _parse_index(text, at)
                if not good:
                    return 0, 0, 0, at, BAD_INDEX
                if normal == 0:
                    return 0, 0, 0, at, ZERO_INDEX
                normal = max(-1, normal - 1 if normal > 0 else normals_before + normal)
    if text[at] != 10 and not is_blank(text[at]):
        return 0, 0, 0, at, BAD_INDEX
    return vertex, texture, normal, at, FINE


@njit(cache=True, nogil=True)
def fill_statements(
    text: ByteArray,
    vertex_starts: Int64Array,
    vertex_sizes: Int32Array,
    texture_starts: Int64Array,
    texture_sizes: Int32Array,
    normal_starts: Int64Array,
    element_kinds: Int32Array,
    element_sizes: Int32Array,
    corners: Int32Array,
    others: Int64Array,
) -> tuple[int, int]:
    """Fill arrays that :func:`count_statements` sized; FINE or what is wrong, and the byte where it is.

    Parameters
    ----------
    text : (bytes,) uint8
    vertex_starts, texture_starts, normal_starts : (rows, 3 or 7) int64
        The byte where each number of each ``v``, ``vt`` or ``vn`` line starts.
    vertex_sizes, texture_sizes : (rows,) int32
        Numbers that stood on each such line.
    element_kinds, element_sizes : (elements,) int32
        FACE, LINE or POINT, and how many corners.
    corners : (corners, 3) int32
        Vertex, texture vertex and normal, 0-based; -1 for none.
    others : (other statements, 3) int64
        Where each starts, and how many vertices and elements stand before it.
    """
    vertices = 0
    textures = 0
    normals = 0
    elements = 0
    filled = 0
    other = 0
    at = 0
    while at < text.size:
        start = _skip_blanks(text, at)
        kind = _line_kind(text, start)
        at = _skip_token(text, start)
        if kind == VERTEX:
            count = _find_numbers(text, at, vertex_starts, vertices)
            if count < 3 or count == 5 or count > VERTEX_NUMBERS:
                return BAD_COORDINATES, start
            vertex_sizes[vertices] = count
            vertices += 1
        elif kind == TEXTURE:
            count = _find_numbers(text, at, texture_starts, textures)
            if count < 1 or count > TEXTURE_NUMBERS:
                return BAD_COORDINATES, start
            texture_sizes[textures] = count
            textures += 1
        elif kind == NORMAL:
            _find_numbers(text, at, normal_starts, normals)
            normals += 1
        elif kind in (FACE, LINE, POINT):
            size = 0
            at = _skip_blanks(text, at)
            while not _at_end(text[at]):
                vertex, texture, normal, end, outcome = _parse_corner(text, at, vertices, textures, normals)
                if outcome != FINE:
                    return outcome, at
                if not 0 <= vertex < vertex_sizes.size:
                    return INDEX_OUTSIDE, at
                if texture >= texture_sizes.size:
                    return TEXTURE_OUTSIDE, at
                corners[filled, 0] = vertex
                corners[filled, 1] = texture
                corners[filled, 2] = normal
                filled += 1
                size += 1
                if kind == POINT:
                    element_kinds[elements] = POINT
                    element_sizes[elements] = 1
                    elements += 1
                at = _skip_blanks(text, end)
            if (kind == FACE and size < 3) or (kind == LINE and size < 2) or size == 0:
                return TOO_FEW_CORNERS, start
            if kind != POINT:
                element_kinds[elements] = kind
                element_sizes[elements] = size
                elements += 1
        elif kind in (OTHER, LIBRARY):
            others[other, 0] = start
            others[other, 1] = vertices
            others[other, 2] = elements
            other += 1
        at = _next_line(text, at)
    return FINE, 0


@njit(cache=True, nogil=True)
def _is_structure(kind: int) -> bool:
    """Whether a line must be the same in every frame: not ``mtllib``, which exporters name after the frame's file."""
    return kind in (FACE, LINE, POINT, OTHER)


@njit(cache=True, nogil=True)
def copy_structure(text: ByteArray, structure: ByteArray, before: Int32Array) -> tuple[int, int]:
    """Copy the lines that must not change from frame to frame; what was used of `structure` and of `before`.

    `structure` has room for them, as long as the text; `before` (lines, 2) receives the vertices and texture vertices
    before each such line, which relative indices count from.
    """
    vertices = 0
    textures = 0
    length = 0
    lines = 0
    at = 0
    while at < text.size:
        start = _skip_blanks(text, at)
        kind = _line_kind(text, start)
        at = _next_line(text, start)
        if kind == VERTEX:
            vertices += 1
        elif kind == TEXTURE:
            textures += 1
        elif _is_structure(kind):
            before[lines, 0] = vertices
            before[lines, 1] = textures
            lines += 1
            for place in range(start, at):
                structure[length] = text[place]
                length += 1
    return length, lines


@njit(cache=True, nogil=True)
def find_positions(text: ByteArray, structure: ByteArray, before: Int32Array, starts: Int64Array) -> bool:
    """Find the positions of another frame, and compare everything else with the first.

    No call in it passes an array, for the reason given in `decimal_text.parse_decimals`. `structure` and `before` are
    from :func:`copy_structure`, cut to length; `starts` (3 * vertices,) receives the byte where each coordinate starts.
    False where vertices or structure are not those of the first frame, byte for byte; `starts` is unfinished then.
    """
    found = 0
    textures = 0
    compared = 0
    lines = 0
    at = 0
    while at < text.size:
        while is_blank(text[at]):
            at += 1
        kind = _kind_of(text[at], text[min(at + 1, text.size - 1)], text[min(at + 2, text.size - 1)])
        if kind == VERTEX:
            if found == starts.size:
                return False
            at += 1
            for _ in range(3):
                while is_blank(text[at]):
                    at += 1
                starts[found] = at
                found += 1
                while text[at] > 32:
                    at += 1
        elif kind == TEXTURE:
            textures += 1
        elif _is_structure(kind):
            if lines == before.shape[0] or before[lines, 0] * 3 != found or before[lines, 1] != textures:
                return False
            lines += 1
            while compared < structure.size and structure[compared] == text[at] and text[at] != 10:
                compared += 1
                at += 1
            if compared == structure.size or structure[compared] != text[at]:
                return False
            compared += 1
        while text[at] != 10:
            at += 1
        at += 1
    return found == starts.size and lines == before.shape[0]
