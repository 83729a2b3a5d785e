"""Cut the motion out of an OBJ file, and fill it again: the text of the first frame, and its libraries of materials.

Coordinates of vertices and normals become zeros. The numbers of texture vertices and of corners of faces are removed
where the decoder's values give the same text again.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pdecodec.errors import InputError
from pdecodec.formats.base.attribute_roles import uv_sets, vertex_slices
from pdecodec.formats.base.carried_fields import StoredFields
from pdecodec.formats.base.carrying import Stripped, is_companion_name
from pdecodec.formats.base.frame_files import find_frames
from pdecodec.formats.base.normals import group_attribute
from pdecodec.formats.base.onto import Fitted
from pdecodec.formats.obj.text import ObjText, read_text, scan
from pdecodec.formats.obj.writer import rows_text
from pdecodec.mesh.arrays import Int64Array
from pdecodec.mesh.sequence import MeshObject, MeshSequence
from pdecodec.system.reading import read_regular

ROOT = "scene.obj"
"""Name of the text in a carrier."""

_LINE = re.compile(rb"^([ \t]*(?:v|vn|vt|f))(?=[ \t])([^\r\n]*)", re.MULTILINE)
_CORNER = re.compile(rb"[-+\d]+(/[-+\d]*)?(/[-+\d]*)?")
_POSITION = re.compile(rb"\A([ \t]+\S+){3}")
_LIBRARY = re.compile(rb"^[ \t]*mtllib[ \t]([^\r\n]*)", re.MULTILINE)
_MATERIAL = re.compile(rb"^[ \t]*newmtl\b", re.MULTILINE)
_TEXTURE = re.compile(rb"^[ \t]*(?:map_\w+|bump|disp|decal|norm|refl)[ \t]([^\r\n]*)", re.MULTILINE)

_FORMS = (b"v", b"t", b"n", b"b")
"""Forms of a corner: vertex alone, with a texture vertex, with a normal, with both."""


class ObjFamily:
    """Removes coded data from OBJ files for the carried scene, and puts it back."""

    def strip(
        self, original: MeshSequence, source: Path, fits: Sequence[Fitted], *, exact_uvs: bool, fields: StoredFields
    ) -> Stripped | None:
        """Return the text of the first frame without geometry, and libraries; None without libraries."""
        first = find_frames(source, ".obj").paths[0]
        text = read_text(first, 0)
        libraries, outside = _libraries(text.data, first.parent)
        contents = {
            "material": sum(len(_MATERIAL.findall(data)) for data in libraries.values()),
            "library of materials": len(libraries),
        }
        if not libraries and all(one.fate != "dropped" for one in original.contents):
            return None
        lines = [found.split() for data in libraries.values() for found in _TEXTURE.findall(data)]
        textures = [words[-1].decode(errors="replace") for words in lines if words]
        if [one.index for one in fits] != list(range(len(original.objects))):
            raise InputError("some of the objects of the OBJ file are left out", code="unsupported-feature")
        objects = [one.item for one in fits]
        # The first of these cuts from which the same corners and texture vertices are restored.
        for cut in ({"vt", "f"} if exact_uvs else {"f"}, {"f"}, set[str]()):
            bare = _stripped(text.data, {*cut, "vn"} if any(map(group_attribute, objects)) else cut)
            if not cut or _is_same(bare, objects, cut, text):
                break
        files = {ROOT: bare, **libraries}
        listed = tuple(dict.fromkeys([*outside, *textures]))
        return Stripped(files, ROOT, {"lines": sorted(cut)}, contents, tuple(libraries), listed)

    def fill(self, folder: Path, cuts: Mapping[str, Any], sequence: MeshSequence, suffix: str) -> None:
        """Fill the text in a folder."""
        path = folder / ROOT
        path.write_bytes(_filled(path.read_bytes(), sequence.objects, set(cuts["lines"])))


def _libraries(text: bytes, folder: Path) -> tuple[dict[str, bytes], list[str]]:
    """Return the libraries of materials in the folder of a text or below it, and the names of libraries elsewhere."""
    found: dict[str, bytes] = {}
    outside: list[str] = []
    for argument in dict.fromkeys(found.strip(b" \t") for found in _LIBRARY.findall(text)):
        whole = argument.decode(errors="replace")
        for name in (whole,) if (folder / whole).is_file() else whole.split():
            if is_companion_name(name) and (folder / name).is_file():
                found[name] = read_regular(folder / name)
            else:
                outside.append(name)
    return found, outside


def _stripped(text: bytes, cut: set[str]) -> bytes:
    def bare(line: re.Match[bytes]) -> bytes:
        word, rest = line[1], line[2]
        match word.strip():
            case b"v":
                return word + _POSITION.sub(b" 0 0 0", rest, count=1)
            case b"vn" if "vn" in cut:
                return word + b" 0 0 0"
            case b"vt" if "vt" in cut:
                return word + _comment(rest)
            case b"f" if "f" in cut:
                numbers = rest.partition(b"#")[0]
                return word + b" " + b"".join(map(_form, _CORNER.finditer(numbers))) + _comment(rest)
        return line[0]

    return _LINE.sub(bare, text)


def _comment(rest: bytes) -> bytes:
    """Return the comment at the end of a line, with the space before it."""
    numbers, mark, comment = rest.partition(b"#")
    return numbers[len(numbers.rstrip(b" \t")) :] + mark + comment if mark else b""


def _form(corner: re.Match[bytes]) -> bytes:
    return _FORMS[(len(corner[1] or b"") > 1) + 2 * (len(corner[2] or b"") > 1)]


_TOKENS = {"v": " {0}", "t": " {0}/{1}", "n": " {0}//1", "b": " {0}/{1}/1"}
"""Text of a corner from its vertex and texture vertex. The numbers of normals follow when normals are written."""

_BARE = re.compile(rb"^([ \t]*)(?:(vt)|f[ \t]+([vtnb]*))(?=[ \t]*(?:#|\r?$))", re.MULTILINE)
"""Pattern of a line whose numbers were removed."""


def _filled(text: bytes, objects: Sequence[MeshObject], cut: set[str]) -> bytes:
    """Return a text with the texture vertices and faces of the objects; ValueError if their number differs."""
    if not cut:
        return text
    coordinates, corners = _texture_lines(objects), _corners(objects)

    def line(found: re.Match[bytes]) -> bytes:
        if found[2]:
            return found[1] + next(coordinates) if "vt" in cut else found[0]
        if "f" not in cut:
            return found[0]
        tokens = [_TOKENS[form].format(*next(corners)) for form in found[3].decode()]
        return found[1] + b"f" + "".join(tokens).encode()

    try:
        return _BARE.sub(line, text)
    except StopIteration:
        raise ValueError("the text has more texture vertices or corners than the mesh") from None


def _texture_lines(objects: Sequence[MeshObject]) -> Iterator[bytes]:
    for item in objects:
        for uv in uv_sets(item)[:1]:
            yield from rows_text(uv.values.astype(np.float32), "vt").splitlines()


def _corners(objects: Sequence[MeshObject]) -> Iterator[tuple[int, int]]:
    """Yield the numbers of the vertex and texture vertex, from 1, of each corner of all faces."""
    textures = 0
    for item, own in zip(objects, vertex_slices(objects), strict=True):
        vertices: Int64Array = item.connectivity.face_indices.astype(np.int64) + own.start + 1
        uv = next(iter(uv_sets(item)), None)
        rows = np.full(vertices.size, -1) if uv is None or uv.indices is None else uv.indices.astype(np.int64)
        yield from zip(vertices.tolist(), (rows + textures + 1).tolist(), strict=True)
        textures += 0 if uv is None else len(uv.values)


def _is_same(text: bytes, objects: Sequence[MeshObject], cut: set[str], other: ObjText) -> bool:
    """Return whether a text, once filled, has the corners and texture vertices of another text."""
    try:
        ours, theirs = scan(ObjText(other.path, 0, _filled(text, objects, cut))), scan(other)
    except (InputError, ValueError):
        return False
    return (
        np.array_equal(ours.element_sizes, theirs.element_sizes)
        and np.array_equal(ours.corners[:, :2], theirs.corners[:, :2])
        and np.array_equal(ours.corners[:, 2] < 0, theirs.corners[:, 2] < 0)
        and np.array_equal(ours.textures.view(np.uint32), theirs.textures.view(np.uint32))
    )
