"""One OBJ file read in full: numbers, elements, and every other statement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pdecodec.errors import InputError
from pdecodec.formats.decimal_text import Int64Array
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
from pdecodec.formats.obj_text import ObjText
from pdecodec.sequence import Float32Array, Int32Array

_MESSAGES = {
    BAD_INDEX: "expected a vertex index, found {token!r}; correct or export it again",
    ZERO_INDEX: "index 0 in {token!r}; OBJ counts from 1, or back from -1",
    INDEX_OUTSIDE: "{token!r} refers to a vertex that is not there, the file has {vertices}; export it again",
    TEXTURE_OUTSIDE: "{token!r} refers to a texture vertex that is not there, the file has {textures}; export it again",
    TOO_FEW_CORNERS: "{token!r} has too few vertices; a face has 3 or more, a line 2 or more, a point 1 or more",
    BAD_COORDINATES: "{token!r} has an unusual count of numbers; v takes 3, 4, 6 or 7, vt takes 1 to 3",
}


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
    normals : int
        Count of ``vn`` lines.
    element_kinds, element_sizes : (elements,) int32
    corners : (corners, 2) int32
        Vertex and texture vertex of each corner of each element, from 0; -1 for no texture vertex.
    others : (statements, 3) int64
        Byte, vertices before, elements before each other statement.
    """

    text: ObjText
    vertex_numbers: Float32Array
    vertex_sizes: Int32Array
    texture_numbers: Float32Array
    texture_size: int
    normals: int
    element_kinds: Int32Array
    element_sizes: Int32Array
    corners: Int32Array
    others: Int64Array

    @property
    def positions(self) -> Float32Array:
        """(vertices, 3) float32 [scene units]."""
        return self.vertex_numbers[:, :3]


def scan(text: ObjText, *, frame: int | None = None) -> ObjScan:
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
        raise InputError("there are no vertices (v lines); is this an OBJ file?", path=text.path, frame=frame)
    vertex_starts = np.full((vertices, VERTEX_NUMBERS if long_vertices else 3), -1, np.int64)
    vertex_sizes = np.zeros(vertices, np.int32)
    texture_starts = np.full((textures, TEXTURE_NUMBERS), -1, np.int64)
    texture_sizes = np.zeros(textures, np.int32)
    element_kinds = np.zeros(elements, np.int32)
    element_sizes = np.zeros(elements, np.int32)
    corners = np.zeros((corner_count, 2), np.int32)
    others = np.zeros((other_count, 3), np.int64)
    outcome, offset = fill_statements(
        text.codes,
        vertex_starts,
        vertex_sizes,
        texture_starts,
        texture_sizes,
        element_kinds,
        element_sizes,
        corners,
        others,
    )
    if outcome != FINE:
        message = _MESSAGES[outcome].format(token=text.token(offset), vertices=vertices, textures=textures)
        raise text.error(offset, message, frame=frame)
    return ObjScan(
        text=text,
        vertex_numbers=text.parse(vertex_starts, frame=frame),
        vertex_sizes=vertex_sizes,
        texture_numbers=text.parse(texture_starts, frame=frame),
        texture_size=int(texture_sizes.max(initial=0)),
        normals=normals,
        element_kinds=element_kinds,
        element_sizes=element_sizes,
        corners=corners,
        others=others,
    )
