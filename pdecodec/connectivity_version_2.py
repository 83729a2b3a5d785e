"""Connectivity in format version 2: faces and lines in section CONN, the order that they had in section ORDR.

The faces of an object are coded in one of two ways, whichever costs less: as a *surface*, grown across its sides,
with the order of its faces and vertices apart (:mod:`pdecodec.surfacecoding`); or as *polygons* in their order
(:mod:`pdecodec.kernels.polygons`), which is better where a program numbered them row by row. Lines are polygons.
What the coder learns from one object helps it with the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import CorruptFileError, InputError, LimitError
from pdecodec.kernels.memory import new_memory
from pdecodec.kernels.numbers import NUMBER_CELLS, code_number
from pdecodec.kernels.polygons import POLYGON_CELLS, code_polygons
from pdecodec.kernels.rangecoder import (
    COST,
    COST_BITS,
    ENCODE,
    FIRST_BYTES,
    MEASURE,
    POSITION,
    code_bit,
    finish,
    is_finished,
    new_coder,
    new_decoder,
)
from pdecodec.sequence import Connectivity
from pdecodec.surfacecoding import (
    Coding,
    OrderModel,
    SourceMesh,
    SurfaceModel,
    common_size,
    decode_order,
    decode_surface,
    encode_order,
    encode_surface,
    even_cells,
)

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]

MOST_CORNERS = 2**31 - 1
"""Face corners of an object, and points of its lines: they are numbered by int32."""

BYTES_PER_CORNER = 128
"""Peak memory of decoding, per corner: 56 of two records, up to 60 of vertices and faces, the result."""

SURFACE_PREFERENCE = 1.1
"""How much more a surface may cost, order included: it tells apart what a mesh is from how it was numbered."""

FACES, LINES = range(2)
SMALLEST = (3, 1)
"""Corners that a face and a line have at least."""

COUNT, SIZE, CORNERS = range(3)
"""Numbers at the head of faces and of lines: how many there are, their common size or 0, their corners."""


@dataclass
class PolygonModel:
    """What the coder of polygons has learnt; it goes on learning from object to object."""

    cells: Int64Array = field(default_factory=lambda: even_cells(POLYGON_CELLS))
    memory: Int64Array = field(default_factory=new_memory)

    def copy(self) -> PolygonModel:
        return PolygonModel(self.cells.copy(), self.memory.copy())


class _Models:
    """Those of all parts of the coder; they take a megabyte, so each is made where it is first needed."""

    @cached_property
    def heads(self) -> Int64Array:
        return even_cells(2 * 3 * NUMBER_CELLS)

    @cached_property
    def choices(self) -> Int64Array:
        return even_cells(2)

    @cached_property
    def surface(self) -> SurfaceModel:
        return SurfaceModel()

    @cached_property
    def order(self) -> OrderModel:
        return OrderModel()

    @cached_property
    def faces(self) -> PolygonModel:
        return PolygonModel()

    @cached_property
    def lines(self) -> PolygonModel:
        return PolygonModel()

    def polygons(self, kind: int) -> PolygonModel:
        return self.faces if kind == FACES else self.lines


def encode_connectivity(parts: Sequence[Connectivity]) -> tuple[bytes, bytes]:
    """Sections CONN and ORDR: the connectivity of every object, in order.

    Parameters
    ----------
    parts : sequence of Connectivity

    Returns
    -------
    conn : bytes
        Faces and lines; those of a surface in the coder's order.
    ordr : bytes
        The order that vertices and faces of surfaces had; empty where there is none to restore.

    Raises
    ------
    InputError
        If an object has more than MOST_CORNERS corners.
    """
    for part in parts:
        if max(part.face_indices.size, part.line_indices.size) > MOST_CORNERS:
            raise InputError(f"an object has more than {MOST_CORNERS} face corners; split it")
    meshes = [SourceMesh.of(part.face_counts, part.face_indices) if part.face_count else None for part in parts]
    choices, expected = _choose(parts, meshes)
    capacity = 1024 + 2 * expected
    while True:
        conn = Coding(new_coder(ENCODE), np.zeros(capacity, np.uint8))
        ordr = Coding(new_coder(ENCODE), np.zeros(capacity, np.uint8))
        models = _Models()
        for part, mesh, choice in zip(parts, meshes, choices, strict=True):
            _encode_part(conn, ordr, models, part, mesh, choice)
        sizes = [finish(coding.coder, coding.data) for coding in (conn, ordr)]
        if max(sizes) <= capacity:
            return conn.data[: sizes[0]].tobytes(), ordr.data[: sizes[1]].tobytes()
        capacity = max(sizes)


@dataclass(frozen=True)
class _Choice:
    """How the faces of an object are coded."""

    is_surface: bool
    has_border: bool


def _choose(parts: Sequence[Connectivity], meshes: Sequence[SourceMesh | None]) -> tuple[list[_Choice], int]:
    """The cheaper way for each object, and about how many bytes all faces take."""
    choices = []
    models = _Models()
    total = 0
    for part, mesh in zip(parts, meshes, strict=True):
        choice = _Choice(is_surface=False, has_border=False)
        if mesh is not None:
            measure = Coding(new_coder(MEASURE), np.zeros(1, np.uint8))
            surface, order = models.surface.copy(), models.order.copy()
            coded, source_order = encode_surface(measure, surface, mesh, has_border=True)
            encode_order(measure, order, coded, source_order, mesh.used, part.vertex_count)
            surface_cost = int(measure.coder[COST])
            measure = Coding(new_coder(MEASURE), np.zeros(1, np.uint8))
            polygons = models.faces.copy()
            _encode_polygons(measure, polygons, FACES, part)
            polygon_cost = int(measure.coder[COST])
            if surface_cost <= SURFACE_PREFERENCE * polygon_cost:
                choice = _Choice(is_surface=True, has_border=coded.has_border)
                models.surface, models.order = surface, order
            else:
                models.faces = polygons
            total += min(surface_cost, polygon_cost)
        choices.append(choice)
    return choices, total >> (COST_BITS + 3)


def _encode_part(
    conn: Coding, ordr: Coding, models: _Models, part: Connectivity, mesh: SourceMesh | None, choice: _Choice
) -> None:
    for kind in (FACES, LINES):
        counts, indices = _polygons_of(part, kind)
        _code_head(conn, models, kind, counts.size, common_size(counts), indices.size)
        if counts.size == 0:
            continue
        if kind == FACES and mesh is not None:
            _code_choice(conn, models, choice)
            if choice.is_surface:
                coded, order = encode_surface(conn, models.surface, mesh, has_border=choice.has_border)
                encode_order(ordr, models.order, coded, order, mesh.used, part.vertex_count)
                continue
        _encode_polygons(conn, models.polygons(kind), kind, part)


def decode_connectivity(
    conn: bytes, ordr: bytes, vertex_counts: Sequence[int], most_corners: int
) -> list[Connectivity]:
    """Undo :func:`encode_connectivity`.

    Parameters
    ----------
    conn, ordr : bytes
    vertex_counts : sequence of int
        Vertices of each object.
    most_corners : int
        Face corners and line points that the memory limit leaves room for, at BYTES_PER_CORNER each.

    Raises
    ------
    CorruptFileError
        If a section is damaged.
    LimitError
        If there are more corners than `most_corners`.
    """
    conn_data, ordr_data = (np.frombuffer(bytearray(data), np.uint8) for data in (conn, ordr))
    conn_coding = Coding(new_decoder(conn_data), conn_data)
    ordr_coding = Coding(new_decoder(ordr_data), ordr_data)
    models = _Models()
    parts = []
    any_order = False
    for vertices in vertex_counts:
        arrays: list[NDArray[np.int32]] = []
        for kind in (FACES, LINES):
            count, size, corners = _code_head(conn_coding, models, kind, 0, 0, 0)
            _check_head(kind, count, size, corners, most_corners, conn_coding.byte)
            most_corners -= corners
            if count == 0:
                arrays += [np.zeros(0, np.int32)] * 2
                continue
            if kind == FACES:
                choice = _code_choice(conn_coding, models, _Choice(is_surface=False, has_border=False))
                if choice.is_surface:
                    coded = decode_surface(
                        conn_coding, models.surface, size, choice.has_border, count, corners, vertices
                    )
                    arrays += decode_order(ordr_coding, models.order, coded, vertices)
                    any_order = True
                    continue
            arrays += _decode_polygons(conn_coding, models.polygons(kind), kind, vertices, count, size, corners)
        parts.append(Connectivity(vertices, *arrays))
    _check_end(conn_coding, "CONN")
    if ordr and not any_order:
        raise CorruptFileError("section ORDR orders faces that section CONN does not have")
    _check_end(ordr_coding, "ORDR")
    return parts


def _polygons_of(part: Connectivity, kind: int) -> tuple[Int32Array, Int32Array]:
    return (part.face_counts, part.face_indices) if kind == FACES else (part.line_counts, part.line_indices)


def _code_head(coding: Coding, models: _Models, kind: int, count: int, size: int, corners: int) -> tuple[int, int, int]:
    """Code how many polygons there are, their common size, or 0 and their corners; returns the three."""

    def code(number: int, value: int) -> int:
        first = (3 * kind + number) * NUMBER_CELLS
        return int(code_number(coding.coder, coding.data, models.heads, first, value))

    count = code(COUNT, count)
    if count == 0:
        return 0, 0, 0
    size = code(SIZE, size)
    return count, size, count * size if size else code(CORNERS, corners)


def _check_head(kind: int, count: int, size: int, corners: int, most_corners: int, byte: int) -> None:
    if (size and size < SMALLEST[kind]) or not count * SMALLEST[kind] <= corners <= MOST_CORNERS:
        what = f"{count} {('faces', 'lines')[kind]} with {corners} corners"
        raise CorruptFileError(f"section CONN declares {what}, at its byte {byte}")
    if corners > most_corners:
        raise LimitError(f"section CONN declares {corners} corners, more than the memory limit allows")


def _code_choice(coding: Coding, models: _Models, choice: _Choice) -> _Choice:
    is_surface = bool(code_bit(coding.coder, coding.data, models.choices, 0, choice.is_surface))
    has_border = is_surface and bool(code_bit(coding.coder, coding.data, models.choices, 1, choice.has_border))
    return _Choice(is_surface=is_surface, has_border=has_border)


def _encode_polygons(coding: Coding, model: PolygonModel, kind: int, part: Connectivity) -> None:
    counts, indices = _polygons_of(part, kind)
    code_polygons(
        coding.coder, coding.data, model.cells, model.memory, common_size(counts), SMALLEST[kind],
        part.vertex_count, counts.astype(np.int64), indices.astype(np.int64),
    )  # fmt: skip


def _decode_polygons(
    coding: Coding, model: PolygonModel, kind: int, vertices: int, count: int, size: int, corners: int
) -> tuple[Int32Array, Int32Array]:
    counts, indices = np.full(count, size, np.int64), np.zeros(corners, np.int64)
    failed = code_polygons(
        coding.coder, coding.data, model.cells, model.memory, size, SMALLEST[kind], vertices, counts, indices
    )
    if failed:
        raise CorruptFileError(
            f"section CONN refers to a vertex that is not there, or has faces that do not fit it, at its byte "
            f"{coding.byte}"
        )
    return counts.astype(np.int32), indices.astype(np.int32)


def _check_end(coding: Coding, name: str) -> None:
    """Raise unless the bytes end where what they hold does."""
    beyond = int(coding.coder[POSITION]) - coding.data.size
    if beyond < 0:
        raise CorruptFileError(f"section {name} has {-beyond} bytes too many, from its byte {coding.byte} on")
    if beyond > FIRST_BYTES:
        raise CorruptFileError(f"section {name} ends {beyond - FIRST_BYTES} bytes too early, at its byte {coding.byte}")
    if not is_finished(coding.coder, coding.data):
        raise CorruptFileError(f"section {name} ends with bytes that say nothing, at its byte {coding.byte}")
