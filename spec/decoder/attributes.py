"""Section 17 of the specification: ATTR, constant data of objects."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from spec.decoder.contexts import CONNECTIVITY_WEIGHTS, Contexts, MatchModel
from spec.decoder.fields import require
from spec.decoder.mesh import Attribute, Mesh
from spec.decoder.polygons import Corner, polygons_of
from spec.decoder.texts import BYTE_WEIGHTS, PRIMER, ByteModel
from spec.decoder.wedges import CornerTable, Elements, Vector, WedgeReader, normal_of
from spec.decoder.wedgevalues import COMPLEMENT, FLOAT, GRID, LARGEST_CODE, Channel, Field, ValueReader

DOMAINS = ("vertex", "face", "corner", "object")
VALUE_TYPES = ("<f4", "<f8", "<i4", "|u1", "<i8")
FLOATS, COLOURS, INTEGERS, FLAGS, FANS, RAW = range(6)
NOT_INDEXED, BY_VERTEX, LISTED, FIRST_USED = range(4)
FORWARD, BACKWARD, BY_SITE = range(3)
LAST_RULE = FIRST_USED + 5
MOST_CHANNELS = 4
SHIFT_OFFSET = 128


@dataclass(frozen=True)
class Head:
    """What is coded before an attribute's values."""

    domain: str
    kind: int
    columns: int
    rule: int

    @property
    def channels(self) -> int:
        return self.columns - 1 if self.columns else 1

    def check(self) -> None:
        """Refuse what there is not."""
        is_possible = self.rule != BY_VERTEX or self.domain == "corner"
        if self.kind in (FLOATS, COLOURS):
            is_possible &= 1 <= self.channels <= MOST_CHANNELS and (self.kind == FLOATS or self.columns > 0)
        elif self.kind in (INTEGERS, FLAGS):
            is_possible &= self.columns == 0
        elif self.kind == FANS:
            is_possible &= (self.columns, self.rule, self.domain) == (0, NOT_INDEXED, "corner")
        else:
            is_possible &= self.rule < FIRST_USED
        require(is_possible and self.rule <= LAST_RULE, "an attribute of an unknown kind")


class Surface:
    """The polygons of an object, and what is known of its attributes before."""

    def __init__(self, mesh: Mesh, levels: list[Vector]) -> None:
        self.polygons, self.vertices = polygons_of([mesh])
        self.face_count = len(mesh.faces)
        self.levels = levels
        points: dict[tuple[int, ...], int] = {}
        point_of = [points.setdefault(tuple(level), len(points)) for level in levels]
        self.by_vertex = CornerTable(self.polygons, self.vertices)
        self.by_point = CornerTable([[point_of[v] for v in polygon] for polygon in self.polygons], len(points))
        self.normals = [normal_of([levels[v] for v in polygon]) for polygon in self.polygons]
        self.face_corners = [(p, i) for p, face in enumerate(mesh.faces) for i in range(len(face))]
        self.earlier: dict[Corner, int] | None = None
        self.measured: tuple[dict[Corner, int], Field] | None = None

    def elements(self, domain: str, count: int) -> Elements:
        """The elements of a domain; of objects as many as are given."""
        if domain == "vertex":
            corners = ((p, i) for p, polygon in enumerate(self.polygons) for i in range(len(polygon)))
            return Elements(self.vertices, {corner: self.by_vertex.vertex(corner) for corner in corners})
        if domain == "face":
            return Elements(self.face_count, {corner: corner[0] for corner in self.face_corners})
        if domain == "corner":
            return Elements(len(self.face_corners), {corner: i for i, corner in enumerate(self.face_corners)})
        return Elements(count, {})

    def site(self, domain: str, element: int) -> int:
        """Where an element is: the vertex of a corner, any other element itself."""
        return self.by_vertex.vertex(self.face_corners[element]) if domain == "corner" else element

    def in_order(self, domain: str, count: int, order: int) -> list[int]:
        """Elements in an order of rules."""
        elements = list(range(count))
        if order == BACKWARD and domain == "corner":
            return sorted(elements, key=lambda e: (self.face_corners[e][0], -self.face_corners[e][1]))
        return sorted(elements, key=lambda e: self.site(domain, e)) if order == BY_SITE else elements


class AttributeReader:
    """Reads attributes one after the other; what it learns from one helps it with the next."""

    def __init__(self, contexts: Contexts) -> None:
        self._contexts = contexts
        self._texts = ByteModel(contexts, "texts", primer=PRIMER)
        self._bytes = ByteModel(contexts, "bytes")
        self._wedges = {name: WedgeReader(contexts, name) for name in ("rows", "integers", "fans", "channels")}
        self._steps = {name: MatchModel(contexts, name) for name in ("rows", "integers")}

    def read(self, surface: Surface) -> Attribute:
        """One attribute."""
        contexts = self._contexts
        name = self._texts.read_text()
        domain, kind = contexts.number("domain"), contexts.number("kind")
        require(domain < len(DOMAINS) and kind < RAW + len(VALUE_TYPES), "an attribute of an unknown kind")
        head = Head(DOMAINS[domain], kind, contexts.number("columns"), contexts.number("rule"))
        head.check()
        count = contexts.number("elements") if head.domain == "object" else 0
        rows = contexts.number("rows") if head.rule == LISTED else 0
        labels = []
        for _ in range(contexts.number("labels")):
            contexts.check_not_ended()
            labels.append(self._texts.read_text())
        require(max(count, rows, head.columns) <= LARGEST_CODE, "an attribute is too large")
        contexts.check_not_ended()
        elements = surface.elements(head.domain, count)
        indices = None
        if head.rule == LISTED:
            indices = self._read_integers("rows", surface, elements)
            require(all(-1 <= index < rows for index in indices), "an index out of range")
            of_corner = {corner: indices[element] for corner, element in elements.of_corner.items()}
            elements = Elements(rows, {corner: row for corner, row in of_corner.items() if row >= 0})
        elif head.rule == BY_VERTEX:
            indices = [surface.by_vertex.vertex(corner) for corner in surface.face_corners]
            elements = surface.elements("vertex", 0)
        values, keys = self._read_values(surface, head, elements)
        if head.rule >= FIRST_USED:
            order, is_global = divmod(head.rule - FIRST_USED, 2)
            numbers: dict[tuple[object, ...], int] = {}
            indices = [0] * elements.count
            first = []
            for element in surface.in_order(head.domain, elements.count, order):
                key = (0 if is_global else surface.site(head.domain, element), *keys[element])
                if key not in numbers:
                    numbers[key] = len(first)
                    first.append(element)
                indices[element] = numbers[key]
            values = values[first]
        return Attribute(name, head.domain, values, indices, labels)

    def _read_values(self, surface: Surface, head: Head, elements: Elements) -> tuple[np.ndarray, list[Vector]]:
        """Values of all elements, and what rows are equal by."""
        shape = (elements.count, head.channels) if head.columns else (elements.count,)
        if head.kind in (FLOATS, COLOURS):
            channels, codes = self._read_channels(surface, head, elements)
            if head.kind == COLOURS:
                require(all(0 <= code <= 255 for row in codes for code in row), "a byte out of range")
                return np.array(codes, np.uint8).reshape(shape), codes
            bits = [[bits_of(code, channel) for code, channel in zip(row, channels, strict=True)] for row in codes]
            return np.array(bits, np.uint32).reshape(shape).view(np.float32), codes
        if head.kind == FANS:
            wedges = self._read_wedges("fans", surface, surface.by_vertex, elements, has_runs=False)
            fans: dict[int, list[int]] = {}
            numbers = []
            for element, wedge in enumerate(wedges):
                found = fans.setdefault(surface.site("corner", element), [])
                if wedge not in found:
                    found.append(wedge)
                numbers.append(found.index(wedge))
            return np.array(numbers, np.int32), []
        if head.kind >= RAW:
            dtype = np.dtype(VALUE_TYPES[head.kind - RAW])
            count = elements.count * head.channels
            planes = self._bytes.read_bytes(count * dtype.itemsize)
            raw = b"".join(planes[i::count] for i in range(count))
            return np.frombuffer(raw, dtype).reshape(shape), []
        numbers = self._read_integers("integers", surface, elements)
        least, most = (0, 255) if head.kind == FLAGS else (-LARGEST_CODE - 1, LARGEST_CODE)
        require(all(least <= number <= most for number in numbers), "an integer out of range")
        return np.array(numbers, np.uint8 if head.kind == FLAGS else np.int32), [[number] for number in numbers]

    def _read_wedges(
        self, name: str, surface: Surface, table: CornerTable, elements: Elements, *, has_runs: bool
    ) -> list[int]:
        wedges = self._wedges[name].read(table, surface.normals, elements, surface.earlier, has_runs=has_runs)
        if elements.of_corner:
            surface.earlier = {corner: wedges[element] for corner, element in elements.of_corner.items()}
        return wedges

    def _read_integers(self, name: str, surface: Surface, elements: Elements) -> list[int]:
        """Of each element, a number that counts."""
        wedges = self._read_wedges(name, surface, surface.by_point, elements, has_runs=True)
        model, numbers = self._steps[name], [0]
        for _ in range(max(wedges, default=-1) + 1):
            step = model.read(0)
            if step is None:
                step = self._contexts.signed(name, "step")
            model.add(step)
            numbers.append(numbers[-1] + step)
        return [numbers[wedge + 1] for wedge in wedges]

    def _read_channels(self, surface: Surface, head: Head, elements: Elements) -> tuple[list[Channel], list[Vector]]:
        """What codes stand for, and the codes of each element."""
        contexts = self._contexts
        channels = [Channel(GRID, 1, 22) for _ in range(head.channels)]
        if head.kind == FLOATS:
            shift = contexts.number("shift") - SHIFT_OFFSET
            require(abs(shift) < SHIFT_OFFSET, "a unit out of range")
            for channel in channels:
                channel.shift, channel.kind = shift, contexts.number("scale")
                channel.divisor = contexts.number("divisor") if channel.kind != FLOAT else 1
                require(channel.kind <= FLOAT and 1 <= channel.divisor <= LARGEST_CODE, "an unknown scale")
                require(channel.kind == FLOAT or 0 <= shift <= 30, "a unit out of range")
        wedges = self._read_wedges("channels", surface, surface.by_point, elements, has_runs=False)
        count = max(wedges, default=-1) + 1
        for channel in channels:
            channel.is_complete = contexts.number("complete") != 0
            channel.table = self._read_table(contexts.number("table"))
            require(bool(channel.table) or not channel.is_complete or count == 0, "a table without values")
        field = self._field(surface, elements, wedges, count, channels)
        ValueReader(contexts, f"values {head.kind} {head.channels}").read(field, count)
        if elements.of_corner:
            surface.measured = {corner: wedges[element] for corner, element in elements.of_corner.items()}, field
        for codes in field.codes:
            codes[:] = [c.table[code] if c.is_complete else code for c, code in zip(channels, codes, strict=True)]
        return channels, [field.codes[wedge] for wedge in wedges]

    def _read_table(self, size: int) -> list[int]:
        table: list[int] = []
        for _ in range(size):
            self._contexts.check_not_ended()
            if table:
                table.append(table[-1] + 1 + self._contexts.number("table", "gap"))
            else:
                table.append(self._contexts.signed("table", "first"))
        require(not table or -LARGEST_CODE - 1 <= table[0] <= table[-1] <= LARGEST_CODE, "a table out of range")
        return table

    def _field(
        self, surface: Surface, elements: Elements, wedges: list[int], count: int, channels: list[Channel]
    ) -> Field:
        """The wedges as a corner table."""

        def wedge_at(p: int, i: int) -> int:
            element = elements.of_corner.get((p, i))
            return count if element is None else wedges[element]

        polygons = [[wedge_at(p, i) for i in range(len(polygon))] for p, polygon in enumerate(surface.polygons)]
        positions: list[Vector] = [[0, 0, 0] for _ in range(count + 1)]
        others: list[Vector | None] = [None] * (count + 1)
        for element in reversed(range(elements.count)):
            corners, wedge = elements.corners(element), wedges[element]
            positions[wedge], others[wedge] = [0, 0, 0], None
            if corners:
                positions[wedge] = surface.levels[surface.by_vertex.vertex(corners[0])]
                others[wedge] = self._other(surface, corners[0], channels)
        return Field(CornerTable(polygons, count + 1), positions, others, channels)

    def _other(self, surface: Surface, corner: Corner, channels: list[Channel]) -> Vector | None:
        """What the attribute before that measures has at a corner, in the unit of this one."""
        if surface.measured is None or len(surface.measured[1].channels) != len(channels):
            return None
        wedge_of, other = surface.measured
        if corner not in wedge_of:
            return None
        up = channels[0].shift - other.channels[0].shift
        linear = [value << up if up >= 0 else value >> -up for value in other.value(wedge_of[corner])]
        return [min(max(value, -(2**30)), 2**30) for value in linear]


def bits_of(code: int, channel: Channel) -> int:
    """The float32 of a code, as its bits."""
    if channel.kind == FLOAT:
        return code if code >= 0 else -1 - code | 1 << 31
    (value,) = struct.unpack("<f", struct.pack("<f", code / channel.divisor))
    if channel.kind == COMPLEMENT:
        value = 1.0 - value
    (bits,) = struct.unpack("<I", struct.pack("<f", value))
    return int(bits)


def read_attributes(data: bytes, meshes: list[Mesh], levels: list[Vector]) -> None:
    """Fill in the attributes of `meshes`, whose vertices have these levels in the reference frame."""
    if not data:
        return
    contexts = Contexts(data, CONNECTIVITY_WEIGHTS | BYTE_WEIGHTS)
    reader = AttributeReader(contexts)
    first = 0
    for mesh in meshes:
        surface = Surface(mesh, levels[first : first + mesh.vertices])
        first += mesh.vertices
        mesh.attributes = [reader.read(surface) for _ in range(contexts.number("attributes"))]
    contexts.finish()
