"""Section ATTR: constant data of objects, coded over the faces and the reference frame that a decoder has by then.

Values of corners, vertices or faces are coded in two steps: which of them are equal around each point
(:mod:`pdecodec.kernels.wedges`), and what they are: numbers that measure are predicted over the surface
(:mod:`pdecodec.kernels.wedgevalues`), numbers that count follow each other in steps. Rows that are numbered as they are
first used cost nothing to number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pdecodec.attributefield import Codes, Field, best_tables
from pdecodec.attributescales import (
    LARGEST_SHIFT,
    Channels,
    Scales,
    byte_scales,
    codes_of_floats,
    floats_of_codes,
    within_tolerance,
)
from pdecodec.attributesites import (
    BY_VERTEX,
    FIRST_USED,
    LAST_RULE,
    LISTED,
    NOT_INDEXED,
    Surface,
    elements_at,
    fan_numbers,
    is_fans,
    row_numbers,
    surfaces,
    use_first,
)
from pdecodec.codedstream import CodedStream, equal_weights, even_cells
from pdecodec.errors import CorruptFileError, InputError, LimitError
from pdecodec.kernels import wedges
from pdecodec.kernels.facewalk import Corners
from pdecodec.kernels.memory import new_memory
from pdecodec.kernels.texts import LIST_CELLS, code_ascending, code_steps
from pdecodec.kernels.wedgepredict import FLOAT, LARGEST_CODE, LINEAR_BITS
from pdecodec.kernels.wedgevalues import VALUE_CELLS, VALUE_DECISIONS, VALUE_INPUTS, ValueCoding
from pdecodec.sequence import MAX_INDEX, Attribute, AttributeDomain, MeshObject

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]

DOMAINS: tuple[AttributeDomain, ...] = ("vertex", "face", "corner", "object")

FLOATS, COLOURS, INTEGERS, FLAGS, FANS, RAW = range(6)
"""Kinds of values: float32 and uint8 that measure, 1 to 4 a row; int32 and uint8 that count; numbers of the fans that a
vertex's corners fall into; and from RAW on bytes of each of VALUE_TYPES."""

VALUE_TYPES = ("<f4", "<f8", "<i4", "|u1", "<i8")

MOST_CHANNELS = 4

BYTES_PER_CORNER = 320
"""Peak memory of an object with attributes, per corner: how corners hang together, twice, the walk, normals."""

BYTES_PER_ELEMENT = 200
"""Peak memory of an attribute, per element or row: its wedge, that one's fan, its place in the walk and in the rows."""

BYTES_PER_NUMBER = 64
"""Peak memory of an attribute, per number: codes, linear values, lengths, hints, the result."""

BYTES_PER_ATTRIBUTE = 1024
BYTES_PER_LABEL = 128
"""Memory of an attribute without values, and of a short text, as Python holds them."""

SHIFT_OFFSET = LARGEST_SHIFT + 1
"""Added to the shift of a unit, which may be negative."""

UV = "uv"
"""Texture coordinates are attributes of this name, and those whose name begins with it and a colon."""


def encode_attributes(
    objects: Sequence[MeshObject],
    levels: Int64Array,
    *,
    uv_tolerance: float | None = None,
    order: Literal["keep", "free"] = "keep",
) -> bytes:
    """Section ATTR: every attribute of every object; empty where there is none.

    Parameters
    ----------
    objects : sequence of MeshObject
        With faces and vertices in the order in which they are decoded.
    levels : (vertices, 3) int64
        Of the reference frame, as it is decoded; vertices of all objects one after the other.
    uv_tolerance : float or None
        How far texture coordinates may be off on each axis; None keeps them to the last bit.
    order : {"keep", "free"}
        Whether rows of indexed values come back under the numbers they have, or under those that cost nothing. Under a
        tolerance, rows that become equal may come back as one.
    """
    if not any(item.attributes for item in objects):
        return b""

    def write(stream: CodedStream) -> None:
        coder = _AttributeCoder(stream, _Room(None))
        for item, surface in zip(objects, surfaces(objects, levels), strict=True):
            stream.number("attributes", len(item.attributes))
            for attribute in item.attributes:
                coder.code(surface, _plan_of(item, attribute, surface, uv_tolerance, is_free=order == "free"))

    return CodedStream.to_bytes("ATTR", write)


def decode_attributes(
    data: bytes, objects: Sequence[MeshObject], levels: Int64Array, most_bytes: int
) -> list[MeshObject]:
    """Give `objects` the attributes of section ATTR.

    Parameters
    ----------
    data : bytes
    objects : sequence of MeshObject
    levels : (vertices, 3) int64
        Of the reference frame.
    most_bytes : int
        Memory that all attributes together may take.

    Raises
    ------
    CorruptFileError
        If the section is damaged, or an attribute does not fit its object.
    LimitError
        If the attributes need more than `most_bytes`.
    """
    if not data:
        return list(objects)
    stream = CodedStream.of_bytes(data, "ATTR")
    coder = _AttributeCoder(stream, _Room(most_bytes))
    found = []
    for item, surface in zip(objects, surfaces(objects, levels), strict=True):
        attributes = tuple(coder.code(surface, None) for _ in range(stream.number("attributes", 0)))
        try:
            found.append(MeshObject(item.name, item.connectivity, attributes))
        except InputError as error:
            raise CorruptFileError(f"section ATTR is damaged ({error.message})") from error
    stream.check_finished()
    return found


def reorder_attributes(item: MeshObject, rows: Mapping[AttributeDomain, Int64Array]) -> tuple[Attribute, ...]:
    """Attributes of an object whose vertices, faces and corners are brought into another order.

    Parameters
    ----------
    item : MeshObject
    rows : mapping of domain to (rows of the domain,) int64
        Under "vertex", "face" and "corner": for each new one, the old one.
    """
    found = []
    for attribute in item.attributes:
        chosen = rows.get(attribute.domain)
        if chosen is None:
            found.append(attribute)
        elif attribute.indices is not None:
            found.append(replace(attribute, indices=attribute.indices[chosen]))
        elif is_fans(attribute, item.connectivity.face_indices):
            vertices = item.connectivity.face_indices[chosen]
            numbers = fan_numbers(vertices, attribute.values[chosen].astype(np.int64))
            found.append(replace(attribute, values=numbers))
        else:
            found.append(replace(attribute, values=attribute.values[chosen]))
    return tuple(found)


class _Room:
    """Memory that is left for attributes; None where that is no matter."""

    def __init__(self, most_bytes: int | None) -> None:
        self._left = most_bytes

    def check(self, size: int, what: str) -> None:
        """Raise where `size` more bytes are needed for a while, and not there."""
        if self._left is not None and size > self._left:
            raise LimitError(f"section ATTR has {what}, more than the memory limit allows")

    def take(self, size: int, what: str) -> None:
        """Take memory for good."""
        self.check(size, what)
        if self._left is not None:
            self._left -= size


@dataclass(frozen=True)
class _Head:
    """What is coded before an attribute's values.

    Attributes
    ----------
    name : str
    domain : int
        Among DOMAINS.
    kind : int
    columns : int
        0 for values of one dimension, else 1 more than there are.
    rule : int
    elements : int
        Of domain "object"; 0 of others.
    rows : int
        Under rule LISTED; else 0.
    labels : tuple of str
    """

    name: str = ""
    domain: int = 0
    kind: int = 0
    columns: int = 0
    rule: int = 0
    elements: int = 0
    rows: int = 0
    labels: tuple[str, ...] = ()

    @property
    def channels(self) -> int:
        """Numbers in a row."""
        return max(self.columns - 1, 0) if self.columns else 1

    @property
    def is_possible(self) -> bool:
        """Whether there are attributes of this kind."""
        if self.domain >= len(DOMAINS) or self.rule > LAST_RULE or self.kind >= RAW + len(VALUE_TYPES):
            return False
        if self.rule == BY_VERTEX and DOMAINS[self.domain] != "corner":
            return False
        if self.kind in (FLOATS, COLOURS):
            return 1 <= self.channels <= MOST_CHANNELS and (self.kind == FLOATS or self.columns > 0)
        if self.kind in (INTEGERS, FLAGS):
            return self.columns == 0
        if self.kind == FANS:
            return (self.columns, self.rule, DOMAINS[self.domain]) == (0, NOT_INDEXED, "corner")
        return self.rule < FIRST_USED


@dataclass(frozen=True)
class _Plan:
    """How an attribute is coded.

    Attributes
    ----------
    head : _Head
    indices : (elements,) int32 or None
        Under rule LISTED.
    values : array
        Rows of values, one for each element from rule FIRST_USED on.
    channels : Channels or None
        The same, of kinds FLOATS and COLOURS.
    """

    head: _Head
    indices: Int32Array | None
    values: NDArray[Any]
    channels: Channels | None


def _plan_of(
    item: MeshObject, attribute: Attribute, surface: Surface, tolerance: float | None, *, is_free: bool
) -> _Plan:
    """How to code an attribute; InputError for values that are not of VALUE_TYPES."""
    values = np.ascontiguousarray(attribute.values)
    value_type = values.dtype.newbyteorder("<").str
    if value_type not in VALUE_TYPES or values.ndim not in (1, 2):
        what = f"attribute {attribute.name!r} of object {item.name!r} is {values.dtype} {values.shape}"
        raise InputError(f"{what}; rows of float32, float64, int32, int64 or uint8 can be kept")
    values = values.astype(value_type)
    indices = attribute.indices
    kind = _kind_of(attribute, values, surface)
    rows = values.reshape(len(values), math.prod(values.shape[1:]))
    divisor, channels = None, None
    if kind == FLOATS:
        if tolerance is not None and attribute.name.split(":")[0] == UV:
            rows, divisor = within_tolerance(rows, tolerance)
        channels = codes_of_floats(rows, divisor=divisor)
    elif kind == COLOURS:
        channels = Channels(rows.astype(np.int64), byte_scales(rows.shape[1]))
    rule = _plain_rule(attribute, surface)
    if rule == LISTED and kind < FANS and (indices is None or not indices.size or indices.min() >= 0):
        codes = channels.codes if channels else rows.astype(np.int64)
        rule = _rule_of(attribute, surface, codes, is_free=is_free or divisor is not None)
    if rule >= FIRST_USED:
        values = values[indices]
        channels = replace(channels, codes=channels.codes[indices]) if channels else None
    head = _Head(
        attribute.name,
        DOMAINS.index(attribute.domain),
        kind,
        0 if values.ndim == 1 else values.shape[1] + 1,
        rule,
        (len(values) if indices is None else indices.size) if attribute.domain == "object" else 0,
        len(values) if rule == LISTED else 0,
        attribute.labels,
    )
    return _Plan(head, indices, values, channels)


def _kind_of(attribute: Attribute, values: NDArray[Any], surface: Surface) -> int:
    channels = values.shape[1] if values.ndim == 2 else 1
    if values.dtype == np.float32 and 1 <= channels <= MOST_CHANNELS:
        return FLOATS
    if values.dtype == np.uint8 and values.ndim == 2 and 1 <= channels <= MOST_CHANNELS:
        return COLOURS
    if values.dtype in (np.int32, np.uint8) and values.ndim == 1:
        if is_fans(attribute, surface.face_corners) and _can_find_fans(surface, values):
            return FANS
        return INTEGERS if values.dtype == np.int32 else FLAGS
    return RAW + VALUE_TYPES.index(values.dtype.str)


def _can_find_fans(surface: Surface, numbers: NDArray[np.int32]) -> bool:
    """Whether a corner is compared with every fan of its vertex: of many corners only some are looked at."""
    vertices = surface.face_corners
    corners = np.bincount(vertices, minlength=surface.mesh.vertices)
    fans = np.zeros(surface.mesh.vertices, np.int64)
    np.maximum.at(fans, vertices, numbers.astype(np.int64) + 1)
    return bool(((corners <= wedges.MOST_CORNERS) | (fans <= 1) | (fans == corners)).all())


def _plain_rule(attribute: Attribute, surface: Surface) -> int:
    if attribute.indices is None:
        return NOT_INDEXED
    is_by_vertex = attribute.domain == "corner" and len(attribute.values) == surface.mesh.vertices
    return BY_VERTEX if is_by_vertex and np.array_equal(attribute.indices, surface.face_corners) else LISTED


def _rule_of(attribute: Attribute, surface: Surface, codes: Int64Array, *, is_free: bool) -> int:
    """A rule that numbers rows as they are; where they are free, any that has no list."""
    assert attribute.indices is not None
    for rule in range(FIRST_USED, LAST_RULE + 1):
        found, first = use_first(surface, attribute.domain, rule, codes[attribute.indices])
        if len(first) == len(codes) and np.array_equal(found, attribute.indices):
            return rule
    return FIRST_USED if is_free else LISTED


class _AttributeCoder:
    """Codes attributes one after the other; what it learns from one helps it with the next.

    Parameters
    ----------
    stream : CodedStream
    room : _Room
    """

    def __init__(self, stream: CodedStream, room: _Room) -> None:
        self._stream = stream
        self._room = room
        self._wedge_models: dict[str, tuple[Int64Array, Int64Array, Int64Array]] = {}
        self._list_models: dict[str, tuple[Int64Array, Int64Array]] = {}
        self._value_models: dict[tuple[int, int], tuple[Int64Array, Int64Array]] = {}
        self._table_cells = even_cells(LIST_CELLS)

    def code(self, surface: Surface, plan: _Plan | None) -> Attribute:
        """Code an attribute; the one that a decoder gets."""
        head = self._code_head(plan.head if plan else _Head())
        domain = DOMAINS[head.domain]
        count = head.elements if domain == "object" else surface.count_of(domain)
        rows = head.rows if head.rule == LISTED else surface.mesh.vertices if head.rule == BY_VERTEX else count
        self._make_room(surface, head, count, rows)
        elements = surface.elements_of(domain, count)
        indices: Int32Array | None = None
        if head.rule == LISTED:
            wanted = None if plan is None or plan.indices is None else plan.indices.astype(np.int64)
            listed = self._code_integers("rows", surface, elements, wanted)
            if listed.size and not -1 <= listed.min() <= listed.max() < rows:
                raise self._stream.damaged("has an index out of range")
            indices = listed.astype(np.int32)
            of_corner = elements.of_corner
            is_of_one = of_corner >= 0
            of_corner[is_of_one] = indices[of_corner[is_of_one]]
            elements = elements_at(of_corner, rows)
        elif head.rule == BY_VERTEX:
            indices = surface.face_corners.copy()
            elements = surface.elements_of("vertex", rows)
        values, codes = self._code_values(surface, head, elements, plan)
        if head.rule >= FIRST_USED:
            indices, first = use_first(surface, domain, head.rule, codes)
            values = values[first]
        return Attribute(head.name, domain, values, indices, head.labels)

    def _code_head(self, head: _Head) -> _Head:
        stream = self._stream
        name = stream.text(head.name, self._take_text)
        domain = stream.number("domain", head.domain)
        kind = stream.number("kind", head.kind)
        columns = stream.number("columns", head.columns)
        rule = stream.number("rule", head.rule)
        found = _Head(name, domain, kind, columns, rule)
        if not found.is_possible:
            raise stream.damaged("has an attribute of an unknown kind")
        elements = stream.number("elements", head.elements) if DOMAINS[domain] == "object" else 0
        rows = stream.number("rows", head.rows) if rule == LISTED else 0
        labels = []
        for i in range(stream.number("labels", len(head.labels))):
            self._take_text(BYTES_PER_LABEL)
            labels.append(stream.text(head.labels[i] if head.labels else "", self._take_text))
        return replace(found, elements=elements, rows=rows, labels=tuple(labels))

    def _take_text(self, size: int) -> None:
        self._room.take(size, "texts of many bytes")

    def _make_room(self, surface: Surface, head: _Head, count: int, rows: int) -> None:
        what = f"an attribute of {max(count, rows)} rows"
        if max(count, rows, head.columns) > MAX_INDEX:
            raise self._stream.damaged(f"has {what} and {head.columns} columns")
        numbers = max(count, rows) * head.channels
        indices = 0 if head.rule == NOT_INDEXED else count
        self._room.take(BYTES_PER_ATTRIBUTE + numbers * (8 if head.kind > RAW else 4) + 4 * indices, what)
        peak = BYTES_PER_CORNER * surface.corner_count + BYTES_PER_ELEMENT * max(count, rows)
        self._room.check(peak + BYTES_PER_NUMBER * numbers, what)
        self._stream.check_not_ended()

    def _code_values(
        self, surface: Surface, head: _Head, elements: wedges.Elements, plan: _Plan | None
    ) -> tuple[NDArray[Any], Int64Array]:
        """Values of all elements, and the codes that rows are equal by."""
        count = elements.starts.size - 1
        shape = (count,) if head.columns == 0 else (count, head.channels)
        if head.kind in (FLOATS, COLOURS):
            channels = self._code_channels(surface, head, elements, plan.channels if plan else None)
            codes = channels.codes
            if head.kind == FLOATS:
                return floats_of_codes(channels).reshape(shape), codes
            if codes.size and not 0 <= codes.min() <= codes.max() <= 255:
                raise self._stream.damaged("has a byte out of range")
            return codes.astype(np.uint8).reshape(shape), codes
        if head.kind >= RAW:
            dtype = np.dtype(VALUE_TYPES[head.kind - RAW])
            planes = np.zeros(count * head.channels * dtype.itemsize, np.uint8)
            if plan:
                # First bytes of all values, then second bytes: like compresses with like.
                planes = np.frombuffer(plan.values.tobytes(), np.uint8).reshape(-1, dtype.itemsize).T.ravel()
            raw = self._stream.bytes(planes).reshape(dtype.itemsize, -1).T.tobytes()
            return np.frombuffer(raw, dtype).astype(dtype.newbyteorder("=")).reshape(shape), np.zeros((0, 1), np.int64)
        wanted = plan.values.astype(np.int64) if plan else None
        if head.kind == FANS:
            wedge_of, _ = self._code_wedges("fans", surface, surface.by_vertex, elements, wanted, has_runs=False)
            return fan_numbers(surface.face_corners, wedge_of), wedge_of.reshape(-1, 1)
        numbers = self._code_integers("integers", surface, elements, wanted)
        lowest, highest = (0, 255) if head.kind == FLAGS else (-LARGEST_CODE - 1, LARGEST_CODE)
        if numbers.size and not lowest <= numbers.min() <= numbers.max() <= highest:
            raise self._stream.damaged("has an integer out of range")
        return numbers.astype(np.uint8 if head.kind == FLAGS else np.int32), numbers.reshape(-1, 1)

    def _code_wedges(
        self,
        name: str,
        surface: Surface,
        corners: Corners,
        elements: wedges.Elements,
        wanted: Int64Array | None,
        *,
        has_runs: bool,
    ) -> tuple[Int64Array, int]:
        """Wedge of each element, and how many wedges there are."""
        if name not in self._wedge_models:
            weights = equal_weights(wedges.WEDGE_DECISIONS, wedges.WEDGE_INPUTS)
            self._wedge_models[name] = (even_cells(wedges.WEDGE_CELLS), weights, np.zeros(1, np.int64))
        coding = self._stream.coding
        wedge_of, *scratch = np.full((4, elements.starts.size - 1), -1, np.int64)
        found = wedges.code_wedges(
            wedges.WedgeCoding(coding.coder, coding.data, *self._wedge_models[name]),
            corners, elements, surface.normals, surface.earlier, has_runs,
            scratch[0] if wanted is None else wanted, wedge_of, scratch[1], scratch[2],
        )  # fmt: skip
        if found < 0:
            raise self._stream.damaged("ends too early")
        if elements.corners.size:
            surface.earlier = np.where(elements.of_corner >= 0, wedge_of[elements.of_corner], -1)
        return wedge_of, int(found)

    def _code_integers(
        self, name: str, surface: Surface, elements: wedges.Elements, wanted: Int64Array | None
    ) -> Int64Array:
        """(elements,) int64: numbers that count."""
        wedge_of, count = self._code_wedges(name, surface, surface.by_point, elements, wanted, has_runs=True)
        numbers = np.zeros(count, np.int64)
        if wanted is not None:
            numbers[wedge_of] = wanted
        if name not in self._list_models:
            self._list_models[name] = even_cells(LIST_CELLS), new_memory()
        coding = self._stream.coding
        code_steps(coding.coder, coding.data, *self._list_models[name], numbers)
        return numbers[wedge_of]

    def _code_channels(
        self, surface: Surface, head: _Head, elements: wedges.Elements, channels: Channels | None
    ) -> Channels:
        """Codes of all elements' numbers."""
        scales = self._code_scales(head, channels.scales if channels else None)
        wanted = row_numbers(channels.codes) if channels else None
        wedge_of, count = self._code_wedges("channels", surface, surface.by_point, elements, wanted, has_runs=False)
        first = np.zeros(count, np.int64)
        first[wedge_of[::-1]] = np.arange(wedge_of.size)[::-1]
        field = Field(surface, elements, wedge_of, first, scales)
        given = channels.codes[first] if channels else None
        codes = self._code_tables(field, head.channels, given)
        model = head.kind, head.channels
        if model not in self._value_models:
            self._value_models[model] = even_cells(VALUE_CELLS), equal_weights(VALUE_DECISIONS, VALUE_INPUTS)
        coding = self._stream.coding
        if not field.code(ValueCoding(coding.coder, coding.data, *self._value_models[model]), codes):
            raise self._stream.damaged("has a value out of range")
        if elements.corners.size:
            surface.measured = field
        return Channels(codes.full()[wedge_of], scales)

    def _code_scales(self, head: _Head, given: Scales | None) -> Scales:
        if head.kind == COLOURS:
            return byte_scales(head.channels)
        stream = self._stream
        shift = stream.number("shift", given.shift + SHIFT_OFFSET if given else 0) - SHIFT_OFFSET
        if abs(shift) > LARGEST_SHIFT:
            raise stream.damaged("has a unit out of range")
        kinds, divisors = [], []
        for k in range(head.channels):
            kind = stream.number("scale", given.kinds[k] if given else 0)
            divisor = 1 if kind == FLOAT else stream.number("divisor", given.divisors[k] if given else 0)
            if kind > FLOAT or not 1 <= divisor <= LARGEST_CODE:
                raise stream.damaged("has a scale that is not known")
            if kind != FLOAT and not 0 <= shift <= LINEAR_BITS:
                raise stream.damaged("has a unit out of range")
            kinds.append(kind)
            divisors.append(divisor)
        return Scales(tuple(kinds), tuple(divisors), shift)

    def _code_tables(self, field: Field, channels: int, given: Int64Array | None) -> Codes:
        """Tables of values, and room for the codes of wedges; given codes as places in complete tables."""
        stream, coding = self._stream, self._stream.coding
        found = Codes.empty(field.count, channels) if given is None else best_tables(field, given)
        for k in range(channels):
            found.is_complete[k] = stream.number("complete", int(found.is_complete[k])) != 0
            size = stream.number("table", found.tables[k].size)
            if given is None:
                self._room.check(8 * size, f"a table of {size} values")
                found.tables[k] = np.zeros(size, np.int64)
            table = found.tables[k]
            broken = code_ascending(coding.coder, coding.data, self._table_cells, table)
            if broken or (size and not -LARGEST_CODE - 1 <= table[0] <= table[-1] <= LARGEST_CODE):
                raise stream.damaged("has a table that does not fit its values")
            if found.is_complete[k] and size == 0 and field.count:
                raise stream.damaged("has a table without values")
        return found
