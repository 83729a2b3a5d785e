"""Objects and attributes of an OBJ file: what ``o``, ``g``, ``usemtl``, ``s``, ``vt`` and colours say.

Names of faces are states in OBJ: each holds until the next statement of its kind. Here they become one integer
a face. Names that mean "none" in OBJ (``g default``, a bare ``usemtl``, ``s off``) are -1, and 0 for ``s``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.obj_kernels import FACE
from pdecodec.formats.obj_scan import ObjScan
from pdecodec.sequence import Attribute, Connectivity, Int32Array, MeshObject

DEFAULT_NAME = "mesh"
"""Name of an object that the file does not name."""

GEOMETRY_NOT_READ = frozenset({"curv", "curv2", "surf", "fo", "bzp", "bsp", "cdc", "cdp", "res", "call", "csh"})
"""Statements that carry geometry: a file without them would be another model, so they are refused."""

_STATEMENT = re.compile(r"[A-Za-z_]\w*", re.ASCII)


@dataclass
class _State:
    """One kind of name: its labels, and from which element on each holds (-1: none)."""

    labels: dict[str, int] = field(default_factory=dict)
    starts: list[int] = field(default_factory=lambda: [0])
    values: list[int] = field(default_factory=lambda: [-1])

    def change(self, element: int, label: str | None) -> None:
        self.starts.append(element)
        self.values.append(-1 if label is None else self.labels.setdefault(label, len(self.labels)))

    def per_element(self, elements: int) -> Int32Array:
        return np.repeat(np.asarray(self.values, np.int32), np.diff([*self.starts, elements]))


@dataclass(frozen=True)
class _Part:
    """A range of vertices and elements under one ``o``."""

    name: str | None
    vertices: tuple[int, int]
    elements: tuple[int, int]


@dataclass(frozen=True, eq=False)
class ObjModel:
    """What an OBJ file says beside positions."""

    objects: tuple[MeshObject, ...]
    metadata: Mapping[str, str]
    notices: tuple[str, ...]


def build_model(scan: ObjScan, *, frame: int | None = None) -> ObjModel:
    """Objects, attributes, metadata and notices of a scanned file.

    Each ``o`` becomes an object where its elements use only vertices declared under it; otherwise the file is
    one object and the names are a face attribute ``"object"``.

    Raises
    ------
    InputError
        With file and line, for statements that carry geometry we do not read, or that are none at all.
    """
    states = {"group": _State(), "material": _State(), "smoothing": _State(), "object": _State()}
    parts = [_Part(None, (0, 0), (0, 0))]
    metadata: dict[str, str] = {}
    left_out: dict[str, None] = {}
    for offset, vertices, elements in scan.others.tolist():
        word, argument = _statement(scan, offset, frame)
        match word:
            case "o":
                states["object"].change(elements, argument or None)
                parts.append(_Part(argument or None, (vertices, vertices), (elements, elements)))
            case "g":
                states["group"].change(elements, argument if argument not in ("", "default") else None)
            case "usemtl":
                states["material"].change(elements, argument or None)
            case "s":
                states["smoothing"].change(elements, _smoothing_group(scan, offset, argument, frame))
            case "mtllib":
                metadata["mtllib"] = argument
            case _:
                left_out[word] = None
    builder = _Builder(scan, states)
    ranges = _complete(parts, scan)
    if builder.parts_are_separate(ranges):
        objects = tuple(builder.build(part, alone=len(ranges) == 1) for part in ranges)
    else:
        objects = (builder.build_whole(ranges),)
    return ObjModel(objects, metadata, builder.notices(tuple(left_out)))


def _as_text(name: bytes) -> str:
    try:
        return name.decode("utf-8")
    except UnicodeDecodeError:
        return name.decode("latin-1")  # what older exporters write; every byte is a letter of it


def _statement(scan: ObjScan, offset: int, frame: int | None) -> tuple[str, str]:
    """Word and argument of a statement, blanks of the argument single."""
    end = scan.text.data.index(b"\n", offset)
    words = [_as_text(token) for token in scan.text.data[offset:end].split()]
    word = words[0]
    if not _STATEMENT.fullmatch(word):
        raise scan.text.error(
            offset, f"{scan.text.token(offset)!r} is not an OBJ statement; check the file", frame=frame
        )
    if word in GEOMETRY_NOT_READ:
        raise scan.text.error(
            offset, f"curves and surfaces ({word}) are not read; export polygons instead", frame=frame
        )
    return word, " ".join(words[1:])


def _smoothing_group(scan: ObjScan, offset: int, argument: str, frame: int | None) -> str | None:
    if argument in ("", "off"):
        return None
    if not re.fullmatch(r"\d{1,9}", argument, re.ASCII):
        raise scan.text.error(offset, f"a smoothing group is a number or off, not {argument[:40]!r}", frame=frame)
    return None if int(argument) == 0 else argument


def _complete(parts: list[_Part], scan: ObjScan) -> list[_Part]:
    """Give each part its end, the start of the next, and drop empty ones."""
    vertex_ends = [part.vertices[0] for part in parts[1:]] + [scan.vertex_sizes.size]
    element_ends = [part.elements[0] for part in parts[1:]] + [scan.element_sizes.size]
    complete = [
        _Part(part.name, (part.vertices[0], vertex_end), (part.elements[0], element_end))
        for part, vertex_end, element_end in zip(parts, vertex_ends, element_ends, strict=True)
    ]
    return [part for part in complete if part.vertices[0] < part.vertices[1] or part.elements[0] < part.elements[1]]


class _Builder:
    """Cuts a scanned file into objects."""

    def __init__(self, scan: ObjScan, states: Mapping[str, _State]) -> None:
        self._scan = scan
        elements = scan.element_sizes.size
        self._states = {name: state.per_element(elements) for name, state in states.items()}
        self._labels = {name: tuple(state.labels) for name, state in states.items()}
        self._corner_starts = np.concatenate([[0], np.cumsum(scan.element_sizes, dtype=np.int64)])
        self._is_face = scan.element_kinds == FACE

    def parts_are_separate(self, parts: list[_Part]) -> bool:
        names = [part.name or DEFAULT_NAME for part in parts]
        if len(set(names)) < len(names) or any(part.vertices[0] == part.vertices[1] for part in parts):
            return False
        for part in parts:
            used = self._corners(part)[:, 0]
            if used.size and not (part.vertices[0] <= used.min() and used.max() < part.vertices[1]):
                return False
        return True

    def build_whole(self, parts: list[_Part]) -> MeshObject:
        """The file as one object, named by the part that declares every vertex or by the only name there is."""
        vertices = (0, self._scan.vertex_sizes.size)
        name = next((part.name for part in parts if part.vertices == vertices), None)
        names = np.unique(self._states["object"])
        only_name = names.size == 1 and names[0] >= 0 and name is None
        if only_name:
            name = self._labels["object"][names[0]]
        part = _Part(name, vertices, (0, self._scan.element_sizes.size))
        return self.build(part, alone=True, keep_names=not only_name)

    def build(self, part: _Part, *, alone: bool, keep_names: bool = False) -> MeshObject:
        start, stop = part.elements
        sizes = self._scan.element_sizes[start:stop]
        is_face = self._is_face[start:stop]
        on_face = np.repeat(is_face, sizes)
        corners = self._corners(part)
        vertices = corners[:, 0] - np.int32(part.vertices[0])
        connectivity = Connectivity(
            part.vertices[1] - part.vertices[0],
            face_counts=sizes[is_face],
            face_indices=vertices[on_face],
            line_counts=sizes[~is_face],
            line_indices=vertices[~on_face],
        )
        attributes = [
            self._uv(corners[on_face, 1], compact=not alone),
            self._color(part),
            *(
                self._names(name, self._states[name][start:stop][is_face])
                for name in ("object", "group", "material", "smoothing")
                if name != "object" or keep_names
            ),
        ]
        return MeshObject(part.name or DEFAULT_NAME, connectivity, tuple(item for item in attributes if item))

    def _corners(self, part: _Part) -> Int32Array:
        start, stop = self._corner_starts[list(part.elements)]
        return self._scan.corners[start:stop]

    def _uv(self, indices: Int32Array, *, compact: bool) -> Attribute | None:
        used = np.unique(indices[indices >= 0])
        if used.size == 0:
            return None
        values = self._scan.texture_numbers[:, : max(2, self._scan.texture_size)]
        if compact:
            indices = np.where(indices >= 0, np.searchsorted(used, indices), -1)
            values = values[used]
        return Attribute("uv", "corner", values.copy(), indices=np.ascontiguousarray(indices, np.int32))

    def _color(self, part: _Part) -> Attribute | None:
        sizes = self._scan.vertex_sizes[slice(*part.vertices)]
        colored = sizes >= 6
        if not colored.any():
            return None
        width = 4 if (sizes == 7).any() else 3
        values = self._scan.vertex_numbers[slice(*part.vertices), 3 : 3 + width].copy()
        if width == 4:
            values[sizes == 6, 3] = 1.0
        if colored.all():
            return Attribute("color", "vertex", values)
        indices = np.where(colored, np.cumsum(colored) - 1, -1).astype(np.int32)
        return Attribute("color", "vertex", values[colored], indices=indices)

    def _names(self, name: str, of_faces: NDArray[np.int32]) -> Attribute | None:
        used = np.unique(of_faces[of_faces >= 0])
        if used.size == 0:
            return None
        labels = self._labels[name]
        if name == "smoothing":
            numbers = np.asarray([int(label) for label in labels], np.int32)
            return Attribute(name, "face", np.where(of_faces >= 0, numbers[of_faces], np.int32(0)))
        values = np.where(of_faces >= 0, np.searchsorted(used, of_faces), -1).astype(np.int32)
        return Attribute(name, "face", values, labels=tuple(labels[index] for index in used))

    def notices(self, left_out: tuple[str, ...]) -> tuple[str, ...]:
        scan = self._scan
        lines = ~self._is_face
        notices = []
        if scan.normals:
            notices.append("normals (vn) are not kept; compute them from the positions")
        if (scan.vertex_sizes == 4).any():
            notices.append("the weight of vertices (the fourth number of v) is not kept")
        if (scan.corners[np.repeat(lines, scan.element_sizes), 1] >= 0).any():
            notices.append("texture vertices of lines (l v/vt) are not kept")
        if any((self._states[name][lines] >= 0).any() for name in ("group", "material")):
            notices.append("groups and materials of lines and points are not kept")
        if left_out:
            notices.append(f"statements not kept: {', '.join(left_out)}")
        return tuple(notices)
