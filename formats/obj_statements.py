"""The text of one OBJ frame: what is the same in every frame is made once, positions each time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.formats.attribute_roles import colors, uv_sets
from pdecodec.formats.decimal_text import NUMBER_WIDTH, format_rows, format_rows_plainly
from pdecodec.formats.obj_objects import DEFAULT_NAME
from pdecodec.sequence import Attribute, Float32Array, MeshObject, MeshSequence

_FACE_STATEMENTS = (("object", "o {}", ""), ("group", "g {}", "g default"), ("material", "usemtl {}", "usemtl"))
"""Face attributes with labels: name, the statement that sets one, and the one that unsets it."""


def _one_line(name: str) -> str:
    """A name as OBJ can hold it: no line breaks, no zero bytes, blanks single, no continuation at its end."""
    return b" ".join(name.replace("\0", "").encode("utf-8", "replace").split()).decode().rstrip("\\")


def main_uv(item: MeshObject) -> Attribute | None:
    """The UV set that OBJ has room for."""
    return next(iter(uv_sets(item)), None)


def vertex_color(item: MeshObject) -> Attribute | None:
    """The colours that OBJ has room for."""
    return next((one for one in colors(item) if one.domain == "vertex"), None)


class FrameText:
    """Makes the text of frames of one sequence.

    Parameters
    ----------
    sequence : MeshSequence
        Its objects, and the ``mtllib`` of its metadata.
    """

    def __init__(self, sequence: MeshSequence) -> None:
        library = sequence.metadata.get("mtllib")
        self._head = f"mtllib {_one_line(library)}\n".encode() if library else b""
        self._objects: list[_ObjectText] = []
        alone = len(sequence.objects) == 1
        vertices = textures = 0
        names_held: set[str] = set()
        for item in sequence.objects:
            text = _ObjectText(item, vertices, textures, names_held, alone=alone)
            vertices = text.vertices.stop
            textures += text.texture_count
            self._objects.append(text)

    def of_frame(self, points: Float32Array, frame: int) -> Iterator[bytes]:
        """The text of a frame, in parts.

        Parameters
        ----------
        points : (vertices, 3) float32
        frame : int
            For errors.

        Raises
        ------
        InputError
            If a position is not finite.
        """
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if bad.size:
            raise InputError(
                f"vertex {bad[0]} is not finite ({points[bad[0]].tolist()}), OBJ has no text for it; "
                "repair the sequence",
                frame=frame,
            )
        yield self._head
        for item in self._objects:
            yield item.before
            yield vertex_text(points[item.vertices], item.color)
            yield item.after


class _ObjectText:
    """The statements of one object, around its positions."""

    def __init__(
        self, item: MeshObject, first_vertex: int, first_texture: int, names_held: set[str], *, alone: bool
    ) -> None:
        attributes: dict[tuple[str, str], Attribute] = {
            (attribute.name, attribute.domain): attribute for attribute in item.attributes
        }
        self.vertices = slice(first_vertex, first_vertex + item.vertex_count)
        # Unnamed, a file whose faces have object names comes back as it was: `o` before the vertices is a name too.
        unnamed = alone and item.name == DEFAULT_NAME and ("object", "face") in attributes
        self.before = b"" if unnamed else f"o {_one_line(item.name)}\n".encode()
        self.color = _color_rows(vertex_color(item), item.vertex_count)
        uv = main_uv(item)
        uv_text, uv_indices, self.texture_count = _texture(uv, item.connectivity.face_indices.size)
        lines = _face_lines(item, first_vertex + 1, uv_indices, first_texture + 1)
        changes = _changes(item, attributes, names_held, with_objects=alone)
        faces = "".join(
            f"{changes[face]}{line}\n" if face in changes else f"{line}\n" for face, line in enumerate(lines)
        )
        self.after = b"".join((uv_text, faces.encode(), _polyline_text(item, first_vertex + 1)))


def vertex_text(points: Float32Array, color: Float32Array | None) -> bytes:
    """``v`` lines.

    Parameters
    ----------
    points : (vertices, 3) float32, finite
    color : (vertices, 3 or 4) float32 or None
        NaN rows have no colour.
    """
    if color is None:
        return _rows_text(points, b"v")
    colored = np.isfinite(color[:, 0])
    if colored.all():
        return _rows_text(np.hstack([points, color]), b"v")
    return b"".join(
        _rows_text(np.concatenate([point, shade])[None] if has else point[None], b"v")
        for point, shade, has in zip(points, color, colored.tolist(), strict=True)
    )


def _rows_text(rows: Float32Array, word: bytes) -> bytes:
    out = np.empty(rows.shape[0] * (2 + rows.shape[1] * NUMBER_WIDTH), np.uint8)
    length = format_rows(np.ascontiguousarray(rows), word[0], out)
    return out[:length].tobytes() if length >= 0 else format_rows_plainly(rows, word)


def _color_rows(color: Attribute | None, vertices: int) -> Float32Array | None:
    """Colours by vertex, NaN in every channel for none; integers are taken as parts of 255."""
    if color is None or color.values.ndim != 2 or color.values.shape[1] not in (3, 4):
        return None
    values: Float32Array = color.values.astype(np.float32)
    if color.values.dtype.kind in "iu":
        values = values / np.float32(255)
    values[~np.isfinite(values).all(axis=1)] = np.nan
    if color.indices is None:
        return values
    rows = np.full((vertices, values.shape[1]), np.nan, np.float32)
    has = color.indices >= 0
    rows[has] = values[color.indices[has]]
    return rows


def _texture(uv: Attribute | None, corners: int) -> tuple[bytes, NDArray[np.int64] | None, int]:
    """``vt`` lines, the index of each corner into them from 0 (-1 for none), and how many there are."""
    if uv is None or uv.values.ndim != 2 or uv.values.shape[1] not in (2, 3):
        return b"", None, 0
    with np.errstate(over="ignore"):
        values = uv.values.astype(np.float32)
    if not np.isfinite(values).all():
        raise InputError("a UV is not finite, OBJ has no text for it; repair the attribute")
    rows = _rows_text(values, b"v").replace(b"v", b"vt")
    indices = np.arange(corners) if uv.indices is None else uv.indices.astype(np.int64)
    return rows, indices, uv.values.shape[0]


def _face_lines(
    item: MeshObject, first_vertex: int, uv_indices: NDArray[np.int64] | None, first_texture: int
) -> Iterator[str]:
    vertices = (item.connectivity.face_indices.astype(np.int64) + first_vertex).tolist()
    if uv_indices is None:
        corners = list(map(str, vertices))
    else:
        textures = (uv_indices + first_texture).tolist()
        has = (uv_indices >= 0).tolist()
        corners = [
            f"{vertex}/{texture}" if textured else str(vertex)
            for vertex, texture, textured in zip(vertices, textures, has, strict=True)
        ]
    return _lines_of(corners, item.connectivity.face_counts.tolist(), repeat("f"))


def _polyline_text(item: MeshObject, first_vertex: int) -> bytes:
    counts = item.connectivity.line_counts.tolist()
    points = list(map(str, (item.connectivity.line_indices.astype(np.int64) + first_vertex).tolist()))
    words = ("p" if count == 1 else "l" for count in counts)
    return "".join(f"{line}\n" for line in _lines_of(points, counts, words)).encode()


def _lines_of(tokens: list[str], counts: list[int], words: Iterator[str]) -> Iterator[str]:
    start = 0
    for count, word in zip(counts, words, strict=False):
        yield f"{word} {' '.join(tokens[start : start + count])}"
        start += count


def _changes(
    item: MeshObject,
    attributes: Mapping[tuple[str, str], Attribute],
    names_held: set[str],
    *,
    with_objects: bool,
) -> dict[int, str]:
    """Statements to write before a face: where the name of a face differs from that of the face before.

    `names_held` are the kinds of names that hold at the end of the objects before this one, and are unset where
    this one has none; it is brought up to date.
    """
    faces = item.connectivity.face_count
    changes: dict[int, str] = {}
    if faces == 0:
        return changes
    for name, setting, unsetting in (*_FACE_STATEMENTS, ("smoothing", "s {}", "s off")):
        if name == "object" and not with_objects:
            continue
        attribute = attributes.get((name, "face"))
        values = np.full(faces, -1, np.int64) if attribute is None else _values_by_face(attribute)
        if name == "smoothing":
            labels: dict[int, str] = {value: str(value) for value in np.unique(values[values > 0]).tolist()}
        else:
            labels = dict(enumerate(attribute.labels if attribute else ()))
        held = None if name in names_held else unsetting
        starts = np.flatnonzero(np.diff(values, prepend=values[0] - 1)).tolist()
        for start in starts:
            label = labels.get(int(values[start]))
            statement = unsetting if label is None else setting.format(_one_line(label))
            if statement != held and statement:
                changes[start] = f"{changes.get(start, '')}{statement}\n"
            held = statement
        names_held.discard(name)
        if held != unsetting:
            names_held.add(name)
    return changes


def _values_by_face(attribute: Attribute) -> NDArray[np.int64]:
    values = attribute.values.astype(np.int64)
    if attribute.indices is None:
        return values
    return np.where(attribute.indices >= 0, values[attribute.indices], -1)
