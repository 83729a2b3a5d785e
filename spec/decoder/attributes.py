"""Sections 17.1 and 17.3 to 17.8 of the specification: ATTR, constant data of objects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from spec.decoder.contexts import PRIMER, ByteModel, Contexts, MatchModel
from spec.decoder.fields import require
from spec.decoder.mesh import LARGEST_INDEX, Attribute, Mesh
from spec.decoder.wedges import COMPLEMENT, FLOAT, Body, Channel, Elements, Values, Vector, WedgeReader

DOMAINS = ("vertex", "face", "corner", "object", "cell")
RAW_TYPES = ("<f4", "<f8", "<i4", "|u1", "<i8")
FLOATS, COLOURS, INTEGERS, FLAGS, FANS, RAW = range(6)
NOT_INDEXED, BY_VERTEX, LISTED, FIRST_USED = range(4)
FORWARD, BACKWARD, BY_SITE = range(3)
SHIFT_OFFSET = 128

Codes = list[list[int]]


def read_attributes(data: bytes, meshes: list[Mesh], grid: list[list[int]]) -> None:
    """Read the attributes of `meshes`; `grid` holds the grid coordinates of all vertices."""
    if not data:
        return
    contexts = Contexts(data)
    reader = AttributeReader(contexts)
    first = 0
    for mesh in meshes:
        body = Body(mesh, grid[first : first + mesh.vertices])
        first += mesh.vertices
        mesh.attributes = [reader.read(body) for _ in range(contexts.number("attributes"))]
    contexts.finish()


@dataclass
class Head:
    """17.1: the head of an attribute."""

    domain: str
    kind: int
    columns: int
    rule: int

    @property
    def channels(self) -> int:
        return self.columns - 1 if self.columns else 1

    def check(self) -> None:
        is_possible = self.rule < FIRST_USED + 6 and (self.rule != BY_VERTEX or self.domain == "corner")
        if self.kind in (FLOATS, COLOURS):
            is_possible &= 1 <= self.channels <= 4 and (self.kind == FLOATS or self.columns > 0)
        elif self.kind in (INTEGERS, FLAGS):
            is_possible &= self.columns == 0
        elif self.kind == FANS:
            is_possible &= (self.columns, self.rule, self.domain) == (0, NOT_INDEXED, "corner")
        else:
            is_possible &= self.rule < FIRST_USED
        require(is_possible, "an attribute of an unknown kind")


class AttributeReader:
    """Reads attributes in turn; models adapted by one attribute serve the next."""

    def __init__(self, contexts: Contexts) -> None:
        self._contexts = contexts
        self._texts = ByteModel(contexts, "texts", primer=PRIMER)
        self._bytes = ByteModel(contexts, "bytes")
        self._wedges = {name: WedgeReader(contexts, name) for name in ("rows", "integers", "fans", "channels")}
        self._steps = {name: MatchModel(contexts, name) for name in ("rows", "integers")}

    def read(self, body: Body) -> Attribute:
        """Read one attribute."""
        contexts = self._contexts
        name, domain, kind = self._texts.read_text(), contexts.number("domain"), contexts.number("kind")
        require(domain < len(DOMAINS) and kind < RAW + len(RAW_TYPES), "an attribute of an unknown kind")
        head = Head(DOMAINS[domain], kind, contexts.number("columns"), contexts.number("rule"))
        head.check()
        count = contexts.number("elements") if head.domain == "object" else 0
        rows = contexts.number("rows") if head.rule == LISTED else 0
        labels = [self._texts.read_text() for _ in range(contexts.number("labels"))]
        require(max(count, rows, head.columns) <= LARGEST_INDEX, "an attribute is too large")
        elements, indices = body.elements(head.domain, count), None
        if head.rule == LISTED:
            indices = self._read_integers("rows", body, elements)
            require(all(-1 <= index < rows for index in indices), "an index out of range")
            of_corner = {corner: indices[element] for corner, element in elements.of_corner.items()}
            elements = Elements(rows, {corner: row for corner, row in of_corner.items() if row >= 0})
        elif head.rule == BY_VERTEX:
            indices = [body.by_vertex.vertex[corner] for corner in body.face_corners]
            elements = body.elements("vertex")
        values, codes = self._read_values(body, head, elements)
        if head.rule >= FIRST_USED:
            first, indices = make_rows(body, head, codes)
            values = values[first]
        return Attribute(name, head.domain, values, indices, labels)

    def _read_values(self, body: Body, head: Head, elements: Elements) -> tuple[Any, Codes]:
        """Read the values of all elements, and the codes by which rows are compared."""
        shape = (elements.count, head.channels) if head.columns else (elements.count,)
        if head.kind == FLOATS:
            channels, codes = self._read_channels(body, head, elements)
            columns = np.array(codes, np.int64).reshape(elements.count, head.channels).T
            values = np.array([decode_floats(own, channel) for own, channel in zip(columns, channels, strict=True)])
            return values.T.reshape(shape), codes
        if head.kind == COLOURS:
            _, codes = self._read_channels(body, head, elements)
            require(all(0 <= code <= 255 for row in codes for code in row), "a byte out of range")
            return np.array(codes, np.uint8).reshape(shape), codes
        if head.kind == FANS:
            return np.array(self._read_fans(body, elements), np.int32), []
        if head.kind in (INTEGERS, FLAGS):
            numbers = self._read_integers("integers", body, elements)
            least, most = (0, 255) if head.kind == FLAGS else (-LARGEST_INDEX - 1, LARGEST_INDEX)
            require(all(least <= number <= most for number in numbers), "an integer out of range")
            return np.array(numbers, np.uint8 if head.kind == FLAGS else np.int32), [[number] for number in numbers]
        dtype, count = np.dtype(RAW_TYPES[head.kind - RAW]), elements.count * head.channels
        planes = self._bytes.read_bytes(count * dtype.itemsize)  # 17.8
        return np.frombuffer(b"".join(planes[i::count] for i in range(count)), dtype).reshape(shape), []

    def _read_fans(self, body: Body, elements: Elements) -> list[int]:
        """17.3: read the number of the fan of each corner."""
        fans: dict[int, dict[int, int]] = {}
        numbers = []
        for corner, wedge in enumerate(self._wedges["fans"].read(body, body.by_vertex, elements)):
            at_vertex = fans.setdefault(body.by_vertex.vertex[corner], {})
            numbers.append(at_vertex.setdefault(wedge, len(at_vertex)))
        return numbers

    def _read_integers(self, name: str, body: Body, elements: Elements) -> list[int]:
        """17.4: read an integer for each element."""
        wedges = self._wedges[name].read(body, body.by_point, elements)
        numbers = [0]
        for _ in range(max(wedges, default=-1) + 1):
            numbers.append(numbers[-1] + self._steps[name].read(0, lambda: self._contexts.signed(name, "step")))
        return [numbers[wedge + 1] for wedge in wedges]

    def _read_channels(self, body: Body, head: Head, elements: Elements) -> tuple[list[Channel], Codes]:
        """17.5: read the scale of each channel, and the codes of each element."""
        contexts = self._contexts
        channels = [Channel() for _ in range(head.channels)]
        if head.kind == FLOATS:
            shift = contexts.number("shift") - SHIFT_OFFSET
            require(abs(shift) < SHIFT_OFFSET, "a unit out of range")
            for channel in channels:
                channel.shift, channel.kind = shift, contexts.number("scale")
                channel.divisor = contexts.number("divisor") if channel.kind != FLOAT else 1
                require(channel.kind <= FLOAT and 1 <= channel.divisor <= LARGEST_INDEX, "an unknown scale")
                require(channel.kind == FLOAT or 0 <= shift <= 30, "a unit out of range")
        wedges = self._wedges["channels"].read(body, body.by_point, elements)
        for channel in channels:
            channel.is_complete = contexts.number("complete") != 0
            channel.table = self._read_table(contexts.number("table"))
            require(channel.table or not channel.is_complete or not wedges, "a table without values")
        values = Values(contexts, f"values {head.kind} {head.channels}", body, elements, wedges, channels)
        values.read()
        if elements.of_corner:
            body.measured = values
        codes = [
            [c.table[code] if c.is_complete else code for c, code in zip(channels, own, strict=True)]
            for own in values.codes
        ]
        return channels, [codes[wedge] for wedge in wedges]

    def _read_table(self, size: int) -> list[int]:
        table: list[int] = []
        for _ in range(size):
            step = 1 + self._contexts.number("table", "gap") if table else self._contexts.signed("table", "first")
            table.append(step + (table[-1] if table else 0))
        require(not table or -LARGEST_INDEX - 1 <= table[0] <= table[-1] <= LARGEST_INDEX, "a table out of range")
        return table


def decode_floats(codes: Vector, channel: Channel) -> Any:
    """17.5: convert the codes of a channel to float32."""
    if channel.kind == FLOAT:
        return np.where(codes >= 0, codes, -1 - codes | 1 << 31).astype(np.uint32).view(np.float32)
    values = (codes / channel.divisor).astype(np.float32)
    return np.float32(1.0) - values if channel.kind == COMPLEMENT else values


def make_rows(body: Body, head: Head, codes: Codes) -> tuple[list[int], list[int]]:
    """17.1, rules from 3 on: return the elements that make new rows, and the row of each element."""
    order, is_global = divmod(head.rule - FIRST_USED, 2)
    sites = [body.by_vertex.vertex[e] if head.domain == "corner" else e for e in range(len(codes))]
    elements = list(range(len(codes)))
    if order == BACKWARD and head.domain == "corner":
        elements.sort(key=lambda corner: (body.by_vertex.polygon[corner], -corner))
    elif order == BY_SITE:
        elements.sort(key=lambda element: sites[element])
    numbers: dict[tuple[int, ...], int] = {}
    first: list[int] = []
    indices = [0] * len(codes)
    for element in elements:
        key = (0 if is_global else sites[element], *codes[element])
        if key not in numbers:
            numbers[key] = len(first)
            first.append(element)
        indices[element] = numbers[key]
    return first, indices
