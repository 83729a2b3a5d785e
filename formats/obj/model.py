"""Everything in an OBJ file besides positions: objects, faces, UVs, colours, hard edges, and names of faces.

Names of faces are states in OBJ: each holds until the next statement of its kind. Here they become one integer per
face. Names that mean "none" in OBJ (``g default``, a bare ``usemtl``, ``s off``) become -1, and 0 for ``s``.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import pairwise

import numpy as np

from pdecodec._core import ObjScan
from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.frame_looks import is_same_attribute
from pdecodec.formats.base.normals import normal_group
from pdecodec.formats.base.scene_writing import DEFAULT_NAME
from pdecodec.formats.base.stored_normals import Pose, StoredNormals, read_normal_group
from pdecodec.formats.obj.text import ObjText
from pdecodec.mesh.arrays import Float64Array, Int32Array
from pdecodec.mesh.sequence import Attribute, Connectivity, Content, MeshObject

GEOMETRY_NOT_READ = frozenset({"curv", "curv2", "surf", "fo", "bzp", "bsp", "cdc", "cdp", "res", "call", "csh"})
"""Statements with geometry that is not read. Without it the file would be another model, so these are refused."""


_STATEMENT = re.compile(r"[A-Za-z_]\w*", re.ASCII)


@dataclass
class _State:
    """One kind of name: its labels, and the elements from which each label holds (-1: none)."""

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
    """A range of vertices and elements under one ``o`` statement."""

    name: str | None
    vertices: tuple[int, int]
    elements: tuple[int, int]


def _as_text(name: bytes) -> str:
    try:
        return name.decode("utf-8")
    except UnicodeDecodeError:
        return name.decode("latin-1")  # older exporters write Latin-1, in which every byte is valid


def _statement(text: ObjText, offset: int) -> tuple[str, str]:
    """Return the word and the argument of a statement, with runs of blanks in the argument made single."""
    word, *words = [_as_text(token) for token in text.line(offset).split()]
    if not _STATEMENT.fullmatch(word):
        raise text.error(offset, f"{text.token(offset)!r} is not an OBJ statement; check the file")
    if word in GEOMETRY_NOT_READ:
        raise text.error(offset, f"curves and surfaces ({word}) are not read; export polygons instead")
    return word, " ".join(words)


def _smoothing_group(text: ObjText, offset: int, argument: str) -> str | None:
    if argument in ("", "off"):
        return None
    if not re.fullmatch(r"\d{1,9}", argument, re.ASCII):
        raise text.error(offset, f"a smoothing group is a number or off, not {argument[:40]!r}")
    return None if int(argument) == 0 else argument


class ObjModel:
    """Objects, attributes, metadata and notices of a file; objects are built on first use.

    Each ``o`` statement becomes an object if its elements use only vertices declared under it. Otherwise the file is
    one object, and the names become a face attribute ``"object"``.

    Raises
    ------
    InputError
        With file and line, for statements with geometry that is not read, or text that is no statement.
    """

    def __init__(self, text: ObjText, scan: ObjScan) -> None:
        self._scan = scan
        states = {"group": _State(), "material": _State(), "smoothing": _State(), "object": _State()}
        marks: list[tuple[str | None, int, int]] = [(None, 0, 0)]
        self.metadata: dict[str, str] = {}
        left_out: dict[str, None] = {}
        libraries: dict[str, None] = {}
        for offset, vertices, elements in scan.others.tolist():
            word, argument = _statement(text, offset)
            match word:
                case "o":
                    states["object"].change(elements, argument or None)
                    marks.append((argument or None, vertices, elements))
                case "g":
                    states["group"].change(elements, argument if argument not in ("", "default") else None)
                case "usemtl":
                    states["material"].change(elements, argument or None)
                case "s":
                    states["smoothing"].change(elements, _smoothing_group(text, offset, argument))
                case "mtllib":
                    libraries[argument] = None
                case _:
                    left_out[word] = None
        self._libraries = tuple(libraries)
        if libraries:
            self.metadata["mtllib"] = " ".join(libraries)
        marks.append((None, scan.vertex_count, scan.element_sizes.size))
        self._states = {name: state.per_element(scan.element_sizes.size) for name, state in states.items()}
        self._labels = {name: tuple(state.labels) for name, state in states.items()}
        self._corner_starts = np.concatenate([[0], np.cumsum(scan.element_sizes, dtype=np.int64)])
        self._is_face = scan.is_face.astype(bool)
        self._parts = [
            _Part(name, (vertex, vertex_end), (element, element_end))
            for (name, vertex, element), (_, vertex_end, element_end) in pairwise(marks)
            if vertex < vertex_end or element < element_end
        ]
        self._whole = _Part(None, (0, scan.vertex_sizes.size), (0, scan.element_sizes.size))
        self._is_separate = self._are_separate(self._parts)
        # A part with all vertices and no elements only names the whole object, as our writer writes it.
        named = [
            part for part in self._parts if part.elements[0] < part.elements[1] or part.vertices != self._whole.vertices
        ]
        counts = Counter(part.name or DEFAULT_NAME for part in named)
        several = [repr(name) for name, count in counts.items() if count > 1]
        merged = (f"several objects are called {', '.join(several)}: the file is one object",) if several else ()
        comments = ("#MRGB",) if b"\n#MRGB" in text.data else ()  # ZBrush's colours, which other programs skip
        self.notices = merged + self._notices(left_out) + not_kept(comments, "colours in comments ({}) are not kept")
        self._has_comments = b"#" in text.data

    @cached_property
    def objects(self) -> tuple[MeshObject, ...]:
        """The objects of the file, with their attributes."""
        if self._is_separate:
            return tuple(self._build(part, alone=len(self._parts) == 1) for part in self._parts)
        return (self._build_whole(self._parts, self._whole.vertices),)

    def contents(self) -> Iterator[Content]:
        """List the data of the file that are not data of its objects: names of objects, libraries of materials,
        comments.
        """
        for name in self._labels["object"]:
            yield Content(f"/{name}", "objects", "coded")
        for library in self._libraries:
            yield Content(f"/mtllib {library}", "mtllib", "coded")
        if self._has_comments:
            yield Content("/comments", "comments", "implied")

    def changes_to(self, other: ObjModel) -> Iterator[tuple[str, bool]]:
        """Yield the kinds of data that differ in a file of the same connectivity, each with whether this file
        has any.
        """
        if self._parts != other._parts or self._names_differ("object", other):
            yield "objects", True
        for name, words in (("group", "groups"), ("material", "materials"), ("smoothing", "smoothing groups")):
            if self._names_differ(name, other):
                yield words, bool(self._labels[name])
        mine, others = self._color(self._whole), other._color(other._whole)
        if not is_same_attribute(mine, others):
            yield "vertex colours", mine is not None
        used = self._scan.corners[:, 1]
        used = used[used >= 0]
        if not np.array_equal(self._scan.textures[used], other._scan.textures[used], equal_nan=True):
            yield "UVs", True
        has_normals = [bool((scan.corners[:, 2] >= 0).any()) for scan in (self._scan, other._scan)]
        if has_normals[0] != has_normals[1]:
            yield "normals", has_normals[0]
        if self.metadata != other.metadata:
            yield "names of mtllib", bool(self.metadata)

    def _names_differ(self, name: str, other: ObjModel) -> bool:
        """Return whether the names of a kind differ on some element; the order in which files introduce names
        does not matter.
        """
        numbers = {label: number for number, label in enumerate(self._labels[name])}
        renumbered = np.array([*(numbers.get(label, -2) for label in other._labels[name]), -1], np.int32)
        return not np.array_equal(self._states[name], renumbered[other._states[name]])

    def _are_separate(self, parts: list[_Part]) -> bool:
        names = [part.name or DEFAULT_NAME for part in parts]
        if len(set(names)) < len(names) or any(part.vertices[0] == part.vertices[1] for part in parts):
            return False
        for part in parts:
            used = self._corners(part)[:, 0]
            if used.size and not (part.vertices[0] <= used.min() and used.max() < part.vertices[1]):
                return False
        return True

    def poses(self) -> Iterator[Pose]:
        """Yield the positions of each object, and what returns the normals of its corners."""
        for part in self._parts if self._is_separate else [self._whole]:
            yield self._scan.positions[slice(*part.vertices)], partial(self._normals_of_corners, part)

    def _normals_of_corners(self, part: _Part) -> Float64Array | None:
        """Return the normals of corners of faces (corners, 3), NaN for those without; None if there are none."""
        own, known = slice(*part.elements), self._scan.normals
        rows = self._corners(part)[np.repeat(self._is_face[own], self._scan.element_sizes[own]), 2]
        inside = (rows >= 0) & (rows < len(known))
        normals = np.full((rows.size, 3), np.nan)
        normals[inside] = known[rows[inside]]
        return normals if inside.any() else None

    def _build_whole(self, parts: list[_Part], vertices: tuple[int, int]) -> MeshObject:
        """Return the file as one object. Its name is that of the part with all vertices, or the only name of
        elements.
        """
        name = next((part.name for part in parts if part.vertices == vertices), None)
        names = np.unique(self._states["object"])
        only_name = names.size == 1 and names[0] >= 0 and name is None
        if only_name:
            name = self._labels["object"][names[0]]
        part = _Part(name, vertices, (0, self._scan.element_sizes.size))
        return self._build(part, alone=True, keep_names=not only_name)

    def _build(self, part: _Part, *, alone: bool, keep_names: bool = False) -> MeshObject:
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
            self._normals(corners[on_face, 2], connectivity),
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
        values = self._scan.textures[:, : max(2, self._scan.texture_size)]
        if compact:
            indices = np.where(indices >= 0, np.searchsorted(used, indices), -1)
            values = values[used]
        return Attribute("uv", "corner", values.copy(), indices=np.ascontiguousarray(indices, np.int32))

    def _color(self, part: _Part) -> Attribute | None:
        sizes = self._scan.vertex_sizes[slice(*part.vertices)]
        if not (sizes >= 6).any():
            return None
        width = 4 if (sizes == 7).any() else 3
        values = self._scan.vertex_extras[slice(*part.vertices), :width].copy()
        values[sizes < 6] = 1.0
        if width == 4:
            values[sizes == 6, 3] = 1.0
        return Attribute("color", "vertex", values)

    def _normals(self, indices: Int32Array, connectivity: Connectivity) -> Attribute | None:
        normals = self._scan.normals
        if indices.max(initial=-1) < 0:
            return None
        first, last = int(indices.min()), int(indices.max())
        if first < 0 or last >= len(normals):
            # Corners may refer to missing normals; their indices still say which corners share one.
            return normal_group(connectivity, indices)
        order = np.arange(indices.size)
        stored = StoredNormals("corner", normals[first : last + 1], indices - first)
        return read_normal_group(connectivity, stored, order)

    def _names(self, name: str, of_faces: Int32Array) -> Attribute | None:
        used = np.unique(of_faces[of_faces >= 0])
        if used.size == 0:
            return None
        labels = self._labels[name]
        if name == "smoothing":
            numbers = np.asarray([int(label) for label in labels], np.int32)
            return Attribute(name, "face", np.where(of_faces >= 0, numbers[of_faces], np.int32(0)))
        values = np.where(of_faces >= 0, np.searchsorted(used, of_faces), -1).astype(np.int32)
        return Attribute(name, "face", values, labels=tuple(labels[index] for index in used))

    def _notices(self, left_out: Iterable[str]) -> tuple[str, ...]:
        scan = self._scan
        lines = ~self._is_face
        notices = []
        uncolored = 0
        for part in self._parts if self._is_separate else [self._whole]:
            colored = int(np.count_nonzero(scan.vertex_sizes[slice(*part.vertices)] >= 6))
            uncolored += part.vertices[1] - part.vertices[0] - colored if colored else 0
        if uncolored:
            notices.append(f"{uncolored} of {scan.vertex_count} vertices have no colour: they are white")
        # Texture vertices and normals that no element refers to.
        for word, count, column in (("vt", scan.texture_count, 1), ("vn", len(scan.normals), 2)):
            if count and not (scan.corners[:, column] >= 0).any():
                left_out = {word: None, **dict.fromkeys(left_out)}
        if (scan.vertex_sizes == 4).any():
            notices += not_kept(["weights of v"], "the weight of vertices (the fourth number of v) is not kept")
        if (scan.corners[np.repeat(lines, scan.element_sizes), 1] >= 0).any():
            notices += not_kept(["vt of l"], "texture vertices of lines (l v/vt) are not kept")
        if any((self._states[name][lines] >= 0).any() for name in ("group", "material")):
            notices += not_kept(["g and usemtl of l and p"], "groups and materials of lines and points are not kept")
        return (*notices, *not_kept(left_out, "statements not kept: {}"))
