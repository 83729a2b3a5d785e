"""Write OBJ sequences: one file per frame, all of them or none.

Positions are written with the fewest digits that read back to the same float32. Kept are objects, faces, lines,
points, ``"uv"``, ``"color"``, ``"group"``, ``"material"``, ``"smoothing"`` and ``"object"`` attributes as
:mod:`pdecodec.formats.obj.reader` returns them, fields that are UVs or colours of vertices, hard edges as normals of
each frame, the ``mtllib`` of the metadata, and times, in a comment. Of several UV sets or colours only the main one is
written. OBJ cannot store other attributes and fields: a notice lists those that are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import repeat

import numpy as np

from pdecodec import _core
from pdecodec.errors import InputError
from pdecodec.formats.base.attribute_roles import (
    COLOR,
    UV,
    expanded,
    indexed_rows,
    left_out,
    main_color,
    missing_color_notices,
    uv_sets,
)
from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.frame_files import FOLDER_PADDING, frames_there, is_frame_pattern
from pdecodec.formats.base.frame_writing import FrameBytes, write_frames
from pdecodec.formats.base.normals import NormalRows, group_attribute, normal_rows, shared_attribute
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.scene_writing import DEFAULT_NAME, renamed
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.looks import look_role, looks_of, objects_at, shared_uv_rows
from pdecodec.mesh.sequence import Attribute, MeshObject, MeshSequence

FACES_AT_ONCE = 2**14
"""Faces whose text is made together, which bounds the memory for Python's strings."""

NORMAL_DECIMALS = 4
"""Decimals of normals, as in files of other programs."""

_FACE_STATEMENTS = (("object", "o {}", ""), ("group", "g {}", "g default"), ("material", "usemtl {}", "usemtl"))
"""Face attributes with labels: name, statement that sets a label, statement that unsets it."""


def write_obj(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write OBJ files to a folder (``name`` or ``name/``: ``name/name.0001.obj``), a frame pattern or a single file.

    Raises
    ------
    InputError
        If the output exists or cannot be written, several frames would go to one file, or a position is not finite.
    """
    placed, new_folder = frame_output(output)
    notices: dict[str, None] = {}

    def frame_bytes(run: MeshSequence, first: int) -> FrameBytes:
        lost = left_out(run, "OBJ", _is_written, metadata=("mtllib",))
        names = renamed((item.name, _one_line(item.name) or DEFAULT_NAME) for item in run.objects)
        text = _FrameText(run, output.rate, first, notices)
        lost += not_kept([one.name for one in run.fields if one not in text.looks], "fields not kept: {}")
        notices.update(dict.fromkeys((*lost, *names, *_name_notices(text.items), *missing_color_notices(run))))
        return text.of_frame

    write_frames(sequence, placed, "OBJ", frame_bytes, new_folder=new_folder)
    return tuple(notices)


def frame_output(output: Output) -> tuple[Output, bool]:
    """Return the output with its frame pattern, and whether its folder is new; raises as :func:`write_obj`."""
    path, new_folder = output.path, False
    if not is_frame_pattern(path) and (path.suffix.lower() != ".obj" or path.is_dir()):
        folder, path = path, path / f"{path.resolve().name}.{FOLDER_PADDING}.obj"
        new_folder = not folder.exists()
        frames = set(frames_there(path))
        foreign = sorted(item.name for item in folder.glob("*.obj") if item not in frames)
        if foreign:
            raise InputError(
                f"this folder holds other OBJ files ({foreign[0]}); choose an empty one or a pattern",
                code="output-unwritable",
                path=folder,
            )
    return replace(output, path=path), new_folder


def time_comment(time: float, rate: float) -> bytes:
    """Return the comment with the time [s] and the frame rate of a frame; both numbers read back exactly."""
    return f"# time {float(time)!r} s at {float(rate)!r} frames per second\n".encode()


def check_finite(points: Float32Array, frame: int) -> None:
    """Raise InputError if a position (vertices, 3) is not finite."""
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        raise InputError(
            f"vertex {bad[0]} is not finite ({points[bad[0]].tolist()}), which OBJ cannot store; repair the sequence",
            code="not-finite",
            frame=frame,
        )


def _is_written(item: MeshObject, attribute: Attribute) -> bool:
    if attribute.domain == "face" and attribute.name in ("object", "group", "material", "smoothing"):
        return True
    held = (*uv_sets(item)[:1], main_color(item), group_attribute(item), shared_attribute(item))
    return any(attribute is one for one in held)


def _name_notices(objects: Sequence[MeshObject]) -> Iterator[str]:
    """Yield notices about UV sets and colours that lose their names."""
    for item in objects:
        for one, name in ((next(iter(uv_sets(item)), None), UV), (main_color(item), COLOR)):
            if one is not None and one.name != name:
                yield f"{one.name!r} is written as {name!r}: OBJ stores one, without its name"


def _one_line(name: str) -> str:
    """Return a name as OBJ can store it: one line, no zero bytes, single blanks, no backslash at the end."""
    return b" ".join(name.replace("\0", "").encode("utf-8", "replace").split()).decode().rstrip("\\")


def _written_looks(sequence: MeshSequence) -> list[Field]:
    """Return the fields that OBJ stores as UVs and colours of vertices: attributes of objects take their place."""
    found: list[Field] = []
    has = {UV: any(map(uv_sets, sequence.objects)), COLOR: any(map(main_color, sequence.objects))}
    for one in sorted(looks_of(sequence), key=lambda one: ":" in one.name):
        role = look_role(one)
        if role is not None and not has[role] and (role == UV or one.domain == "vertex"):
            has[role] = True
            found.append(one)
    return found


class _FrameText:
    """Writes the text of frames; text that is the same in every frame is built once.

    Attributes
    ----------
    looks : list of Field
        Fields that are written as UVs and colours.
    items : tuple of MeshObject
        The objects with the values of these fields at the first frame.
    """

    def __init__(self, sequence: MeshSequence, rate: float, first: int, found_later: dict[str, None]) -> None:
        self._sequence, self.looks, self._found_later = sequence, _written_looks(sequence), found_later
        self.items = objects_at(sequence, 0, self.looks, with_all_rows=True)
        shared = [one for one in self.looks if look_role(one) == UV and one.domain == "corner"]
        self._shared = shared_uv_rows(sequence, shared[0]) if shared else {}
        self.items = self._with_shared_uvs(self.items)
        self._times, self._rate, self._first = sequence.times, rate, first
        library = sequence.metadata.get("mtllib")
        self._head = f"mtllib {_one_line(library)}\n".encode() if library else b""
        self._objects: list[_ObjectText] = []
        vertices = textures = normals = 0
        names_held: set[str] = set()
        for item in self.items:
            text = _ObjectText(item, vertices, textures, normals, names_held, alone=len(sequence.objects) == 1)
            vertices = text.vertices.stop
            textures += text.texture_count
            normals += 0 if text.normals is None else text.normals.count
            self._objects.append(text)

    def of_frame(self, points: Float32Array, frame: int) -> Iterator[bytes]:
        """Yield the text of a frame in parts with positions (vertices, 3); InputError if one is not finite."""
        check_finite(points, self._first + frame)
        yield time_comment(self._times[frame], self._rate) + self._head
        items = self.items
        if self.looks:
            gaps: list[Field] = []
            items = self._with_shared_uvs(objects_at(self._sequence, frame, self.looks, with_all_rows=True, gaps=gaps))
            for look in gaps:
                instead = "(0, 0)" if look_role(look) == UV else "white"
                self._found_later[f"where {look.name!r} is not finite it is {instead} in OBJ"] = None
        for item, text in zip(items, self._objects, strict=True):
            own = points[text.vertices]
            yield text.before
            color = _color_rows(main_color(item), item.vertex_count) if self.looks else text.color
            yield rows_text(np.hstack([own, color]), "v")
            yield text.normal_text(own)
            yield _texture_text(next(iter(uv_sets(item)), None)) if self.looks else text.textures
            yield from text.after

    def _with_shared_uvs(self, items: Sequence[MeshObject]) -> tuple[MeshObject, ...]:
        """Return objects whose corners share rows of UVs that change."""
        found = list(items)
        for index, shared in self._shared.items():
            uv = uv_sets(found[index])[0]
            rows = replace(uv, values=expanded(uv)[shared.firsts], indices=shared.rows.astype(np.int32))
            others = [one for one in found[index].attributes if one is not uv]
            found[index] = replace(found[index], attributes=(*others, rows))
        return tuple(found)


class _ObjectText:
    """The statements of one object before and after its positions."""

    def __init__(
        self,
        item: MeshObject,
        first_vertex: int,
        first_texture: int,
        first_normal: int,
        names_held: set[str],
        *,
        alone: bool,
    ) -> None:
        attributes: dict[tuple[str, str], Attribute] = {
            (attribute.name, attribute.domain): attribute for attribute in item.attributes
        }
        self.vertices = slice(first_vertex, first_vertex + item.vertex_count)
        # ``o`` before the vertices would name the object, so it is left out if names of objects are a face attribute:
        # the file then reads back unchanged.
        unnamed = alone and item.name == DEFAULT_NAME and ("object", "face") in attributes
        self.before = b"" if unnamed else f"o {_one_line(item.name)}\n".encode()
        # Smoothing groups alone do not make normals: they are written as ``s`` statements.
        self.normals = None if group_attribute(item) is None else normal_rows(item)
        uv = next(iter(uv_sets(item)), None)
        self.color = _color_rows(main_color(item), item.vertex_count)
        self.textures, uv_indices = _texture_text(uv), None
        self.texture_count = 0 if uv is None else len(uv.values)
        if uv is not None:
            corners_of = item.connectivity.face_indices.size
            uv_indices = np.arange(corners_of) if uv.indices is None else uv.indices.astype(np.int64)
        changes = _changes(item, attributes, names_held, with_objects=alone)
        counts, indices = item.connectivity.face_counts, item.connectivity.face_indices
        self.after: list[bytes] = []
        first = 0
        for start in range(0, len(counts), FACES_AT_ONCE):
            some = counts[start : start + FACES_AT_ONCE].tolist()
            own = slice(first, first + sum(some))
            first = own.stop
            corners = list(map(str, (indices[own].astype(np.int64) + first_vertex + 1).tolist()))
            textures = [""] * len(corners)
            if uv_indices is not None:
                rows = (uv_indices[own] + first_texture + 1).tolist()
                textures = [str(row) if row > first_texture else "" for row in rows]
            if self.normals is not None:
                normals = (self.normals.corner_rows[own] + np.int64(first_normal + 1)).tolist()
                corners = [f"{v}/{t}/{n}" for v, t, n in zip(corners, textures, normals, strict=True)]
            elif uv_indices is not None:
                corners = [f"{v}/{t}" if t else v for v, t in zip(corners, textures, strict=True)]
            lines = enumerate(_lines_of(corners, some, repeat("f")), start)
            self.after.append("".join(f"{changes.get(face, '')}{line}\n" for face, line in lines).encode())
        self.after.append(_polyline_text(item, first_vertex + 1))

    def normal_text(self, points: Float32Array) -> bytes:
        """Return ``vn`` lines at positions (vertices, 3)."""
        if self.normals is None:
            return b""
        return normals_text(self.normals, points)


def normals_text(rows: NormalRows, points: Float32Array) -> bytes:
    """Return ``vn`` lines of normal rows at positions (vertices, 3)."""
    return rows_text(np.round(rows.of(points[None])[0], NORMAL_DECIMALS) + np.float32(0), "vn")


def rows_text(rows: Float32Array, word: str) -> bytes:
    """Return lines of a word and finite numbers (rows, columns); all have nine digits if one needs them."""
    text = _core.write_rows(np.ascontiguousarray(rows), word)
    if text is None:
        return "".join(word + "".join(f" {value:.9g}" for value in row) + "\n" for row in rows.tolist()).encode()
    return text


def _color_rows(color: Attribute | None, vertices: int) -> Float32Array:
    """Return colours per vertex, white if missing or not finite; no columns without colours."""
    if color is None:
        return np.zeros((vertices, 0), np.float32)
    values, indices, _ = indexed_rows(color)
    rows: Float32Array = values if indices is None else values[indices]
    return np.where(np.isfinite(rows).all(axis=1, keepdims=True), rows, np.float32(1))


def _texture_text(uv: Attribute | None) -> bytes:
    """Return ``vt`` lines."""
    if uv is None:
        return b""
    with np.errstate(over="ignore"):
        values = uv.values.astype(np.float32)
    if not np.isfinite(values).all():
        raise InputError("a UV is not finite, which OBJ cannot store; repair the attribute", code="not-finite")
    return rows_text(values, "vt")


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
    """Return the statements to write before each face whose name differs from that of the face before.

    `names_held` has the kinds of names that are set at the end of the previous objects. They are unset if this
    object has none; the set is updated.
    """
    faces = item.connectivity.face_count
    changes: dict[int, str] = {}
    if faces == 0:
        return changes
    for name, setting, unsetting in (*_FACE_STATEMENTS, ("smoothing", "s {}", "s off")):
        if name == "object" and not with_objects:
            continue
        attribute = attributes.get((name, "face"))
        values = np.full(faces, -1, np.int64)
        if attribute is not None:
            rows = np.arange(faces) if attribute.indices is None else attribute.indices
            values = np.where(rows >= 0, attribute.values[rows].astype(np.int64), -1)
        starts = np.flatnonzero(np.diff(values, prepend=values[0] - 1)).tolist()
        if name == "smoothing":
            labels: dict[int, str] = {value: str(value) for value in values[starts].tolist() if value > 0}
        else:
            labels = dict(enumerate(attribute.labels if attribute else ()))
        held = None if name in names_held else unsetting
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
