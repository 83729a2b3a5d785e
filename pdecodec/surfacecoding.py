"""A surface in the order of its coding, and the order of its source: arrays around the compiled coders.

:mod:`pdecodec.kernels.surface` grows the surface, :mod:`pdecodec.kernels.source_order` brings its vertices and faces
back into the order they had.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import CorruptFileError
from pdecodec.kernels import border, face_order, memory, order_records, rangecoder, source_order, surface, vertex_order
from pdecodec.kernels.order_records import OrderCoding
from pdecodec.kernels.runs import RUN_CELLS, code_runs

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]


def even_cells(count: int) -> Int64Array:
    """Cells that know nothing."""
    return np.full(count, rangecoder.EVEN, np.int64)


def equal_weights(sets: int, opinions: int) -> Int64Array:
    """Weights that trust all opinions alike: together more than one, for where they agree they know more than each.

    Parameters
    ----------
    sets : int
        How many sets of weights.
    opinions : int
        How many weights each.

    Returns
    -------
    (sets, opinions) int64
        In 1/65536.
    """
    return np.full((sets, opinions), 6 * 65536 // (5 * opinions), np.int64)


@dataclass(frozen=True)
class Coding:
    """Where bits go to or come from: a coder's state and its bytes, see :mod:`pdecodec.kernels.rangecoder`."""

    coder: Int64Array
    data: UInt8Array

    @property
    def byte(self) -> int:
        """Where damage is noticed when decoding: the coder has looked at the bytes up to this one."""
        return min(int(self.coder[rangecoder.POSITION]), self.data.size)


@dataclass
class SurfaceModel:
    """What the coder of surfaces has learnt; it goes on learning from object to object."""

    cells: Int64Array = field(default_factory=lambda: even_cells(surface.SURFACE_CELLS))
    weights: Int64Array = field(default_factory=lambda: equal_weights(surface.SURFACE_DECISIONS, surface.OPINIONS))
    state: Int64Array = field(default_factory=lambda: np.zeros(surface.STATE_SIZE, np.int64))

    def copy(self) -> SurfaceModel:
        return SurfaceModel(self.cells.copy(), self.weights.copy(), self.state.copy())


@dataclass
class OrderModel:
    """What the coder of orders has learnt; it goes on learning from object to object."""

    run_cells: Int64Array = field(default_factory=lambda: even_cells(RUN_CELLS))
    face_cells: Int64Array = field(default_factory=lambda: even_cells(face_order.FACE_ORDER_CELLS))
    face_weights: Int64Array = field(
        default_factory=lambda: equal_weights(face_order.FACE_ORDER_DECISIONS, source_order.OPINIONS)
    )
    face_state: Int64Array = field(default_factory=lambda: np.zeros(face_order.FACE_STATE_SIZE, np.int64))
    face_memory: Int64Array = field(default_factory=memory.new_memory)
    vertex_cells: Int64Array = field(default_factory=lambda: even_cells(vertex_order.VERTEX_ORDER_CELLS))
    vertex_weights: Int64Array = field(
        default_factory=lambda: equal_weights(vertex_order.PROPOSALS, source_order.OPINIONS)
    )
    vertex_state: Int64Array = field(default_factory=lambda: np.zeros(vertex_order.VERTEX_STATE_SIZE, np.int64))
    vertex_memory: Int64Array = field(default_factory=memory.new_memory)

    def face_coding(self, coding: Coding) -> OrderCoding:
        """For the compiled coder of faces."""
        return OrderCoding(
            coding.coder, coding.data, self.face_cells, self.face_weights, self.face_state, self.face_memory
        )

    def vertex_coding(self, coding: Coding) -> OrderCoding:
        """For the compiled coder of vertices' numbers."""
        return OrderCoding(
            coding.coder, coding.data, self.vertex_cells, self.vertex_weights, self.vertex_state, self.vertex_memory
        )

    def copy(self) -> OrderModel:
        return OrderModel(**{name: array.copy() for name, array in vars(self).items()})


@dataclass(frozen=True)
class SourceMesh:
    """Faces as they are to be encoded.

    Parameters
    ----------
    used : (vertices,) int64
        Vertices of the object that are on a face, ascending; below they are numbered by their place here.
    sizes : (faces,) int32
    corners : (corners,) int32
        Vertex of each corner.
    across : (corners,) int32
        Group of corners whose sides run the other way, or -1.
    members : (corners,) int32
        Corners, group after group; corners of a group have sides between the same vertices in the same direction.
    groups : (groups, 2) int32
        First member and past the last member.
    """

    used: Int64Array
    sizes: Int32Array
    corners: Int32Array
    across: Int32Array
    members: Int32Array
    groups: Int32Array

    @classmethod
    def of(cls, sizes: Int32Array, indices: Int32Array) -> SourceMesh:
        """Find out which sides run against each other.

        Parameters
        ----------
        sizes : (faces,) int32
            At least one face.
        indices : (sum of sizes,) int32
            Vertex of each corner.
        """
        used, corners = np.unique(indices, return_inverse=True)
        following = np.arange(1, indices.size + 1)
        ends = np.cumsum(sizes, dtype=np.int64)
        following[ends - 1] = ends - sizes
        side = corners * np.int64(used.size) + corners[following]
        reverse = corners[following] * np.int64(used.size) + corners
        members = np.argsort(side, kind="stable")
        sides, starts = np.unique(side[members], return_index=True)
        across = np.minimum(np.searchsorted(sides, reverse), sides.size - 1)
        across[sides[across] != reverse] = -1
        groups = np.stack([starts, np.append(starts[1:], indices.size)], axis=1)
        return cls(
            used.astype(np.int64),
            sizes,
            corners.astype(np.int32),
            across.astype(np.int32),
            members.astype(np.int32),
            groups.astype(np.int32),
        )


@dataclass(frozen=True)
class CodedSurface:
    """Faces in the order of their coding.

    Parameters
    ----------
    sizes : (faces,) int32
    sides : (corners, 10) int32
        See :mod:`pdecodec.kernels.border`.
    vertex_count : int
        Vertices that are on a face.
    """

    sizes: Int32Array
    sides: Int32Array
    vertex_count: int

    @property
    def first_corners(self) -> Int32Array:
        """(faces,) int32: the first corner of every face."""
        return (np.cumsum(self.sizes) - self.sizes).astype(np.int32)

    @property
    def has_border(self) -> bool:
        """Whether a side was told to have no face across."""
        return bool((self.sides[:, border.STATE] == border.CLOSED).any())


@dataclass(frozen=True)
class SourceOrder:
    """How a coded surface's faces and vertices stood in the source.

    Parameters
    ----------
    firsts : (faces,) int32
        Of each of the source's faces, the first corner.
    numbers : (vertices,) int32
        Of each vertex, its place among the source's vertices that are on a face.
    """

    firsts: Int32Array
    numbers: Int32Array


def encode_surface(
    coding: Coding, model: SurfaceModel, mesh: SourceMesh, *, has_border: bool
) -> tuple[CodedSurface, SourceOrder]:
    """Code the faces of one object, or measure what they cost.

    Parameters
    ----------
    coding : Coding
    model : SurfaceModel
        Changed.
    mesh : SourceMesh
    has_border : bool
        False only if coding it with True gave a :attr:`CodedSurface.has_border` of False.
    """
    faces, corners = mesh.sizes.size, mesh.corners.size
    ends = np.cumsum(mesh.sizes)
    source_faces = np.stack([ends - mesh.sizes, mesh.sizes, np.zeros(faces, np.int32)], axis=1).astype(np.int32)
    owners = np.repeat(np.arange(faces, dtype=np.int32), mesh.sizes)
    source_corners = np.stack([mesh.corners, owners, mesh.across, mesh.members], axis=1)
    numbers = np.full(mesh.used.size, -1, np.int32)
    face_numbers = np.zeros(faces, np.int32)
    coded = _code_surface(
        coding, model, common_size(mesh.sizes), has_border, faces, corners, mesh.used.size,
        source_faces, source_corners, mesh.groups.copy(), numbers, face_numbers,
    )  # fmt: skip
    places = np.empty(corners, np.int32)
    places[coded.sides[:, border.SOURCE]] = np.arange(corners, dtype=np.int32)
    order = np.empty(mesh.used.size, np.int32)
    order[numbers] = np.arange(mesh.used.size, dtype=np.int32)
    return coded, SourceOrder(places[source_faces[:, surface.FIRST]], order)


def decode_surface(
    coding: Coding, model: SurfaceModel, size: int, has_border: bool, faces: int, corners: int, vertices: int
) -> CodedSurface:
    """Undo :func:`encode_surface`.

    Parameters
    ----------
    coding : Coding
    model : SurfaceModel
        Changed.
    size : int
        Corners of every face, or 0 where they differ.
    has_border : bool
    faces, corners : int
    vertices : int
        Vertices of the object: no more can be on faces.

    Raises
    ------
    CorruptFileError
        If there would be more vertices or corners.
    """
    nothing = np.zeros((1, 4), np.int32)
    return _code_surface(
        coding, model, size, has_border, faces, corners, min(vertices, corners),
        nothing, nothing, nothing, nothing[0], nothing[0],
    )  # fmt: skip


def _code_surface(
    coding: Coding,
    model: SurfaceModel,
    size: int,
    has_border: bool,
    faces: int,
    corners: int,
    most_vertices: int,
    *source: Int32Array,
) -> CodedSurface:
    sizes = np.zeros(faces, np.int32)
    sides = np.zeros((corners, 10), np.int32)
    vertices = np.zeros((most_vertices, 3), np.int32)
    vertices[:, border.BORDER] = -1
    queues = np.full(border.PRIORITIES + 1, -1, np.int32)
    queues[border.PRIORITIES] = 0
    vertex_count = surface.code_surface(
        coding.coder, coding.data, model.cells, model.weights, model.state,
        size, has_border, sizes, sides, vertices, queues, *source,
    )  # fmt: skip
    if vertex_count < 0:
        raise CorruptFileError(
            f"section CONN holds a surface that does not fit its faces and vertices, at its byte {coding.byte}"
        )
    return CodedSurface(sizes, sides, vertex_count)


def encode_order(
    coding: Coding, model: OrderModel, coded: CodedSurface, order: SourceOrder, used: Int64Array, vertices: int
) -> None:
    """Code which vertices are on faces, and the order of the source.

    Parameters
    ----------
    coding : Coding
    model : OrderModel
        Changed.
    coded : CodedSurface
    order : SourceOrder
    used : (vertices on faces,) int64
        Ascending.
    vertices : int
        Vertices of the object.
    """
    breaks = np.flatnonzero(np.diff(used) != 1)
    starts = used[np.append(0, breaks + 1)]
    ends = used[np.append(breaks, used.size - 1)] + 1
    code_runs(coding.coder, coding.data, model.run_cells, used.size, vertices, starts, ends)
    _code_order(coding, model, coded, order.firsts, order.numbers)


def decode_order(
    coding: Coding, model: OrderModel, coded: CodedSurface, vertices: int
) -> tuple[Int32Array, Int32Array]:
    """Undo :func:`encode_order`.

    Parameters
    ----------
    coding : Coding
    model : OrderModel
        Changed.
    coded : CodedSurface
    vertices : int
        Vertices of the object.

    Returns
    -------
    sizes : (faces,) int32
        Corners of each face, in the order of the source.
    indices : (corners,) int32
        Vertex of each corner.

    Raises
    ------
    CorruptFileError
        If there is no such order.
    """
    count = coded.vertex_count
    starts, ends = np.zeros(count, np.int64), np.zeros(count, np.int64)
    runs = code_runs(coding.coder, coding.data, model.run_cells, count, vertices, starts, ends)
    if runs < 0:
        raise CorruptFileError(f"section ORDR numbers vertices that are not there, at its byte {coding.byte}")
    nothing = np.zeros(0, np.int32)
    sizes, indices = _code_order(coding, model, coded, nothing, nothing)
    if runs == 1:
        indices += np.int32(starts[0])
        return sizes, indices
    lengths = ends[:runs] - starts[:runs]
    used = np.arange(count) + np.repeat(starts[:runs] - (np.cumsum(lengths) - lengths), lengths)
    return sizes, used.astype(np.int32)[indices]


def _code_order(
    coding: Coding, model: OrderModel, coded: CodedSurface, firsts: Int32Array, numbers: Int32Array
) -> tuple[Int32Array, Int32Array]:
    """Run the coder; returns the faces in the order of the source, by the numbers of their vertices."""
    records = order_records.new_records(coded.sizes, coded.sides, coded.vertex_count)
    face_order.begin_object(model.face_state)
    vertex_order.begin_object(model.vertex_state)
    candidates = np.zeros((2, face_order.MOST_CANDIDATES, 2), np.int32)
    sizes, corner_numbers = np.empty_like(coded.sizes), np.empty(len(coded.sides), np.int32)
    failed = source_order.code_order(
        model.face_coding(coding), model.vertex_coding(coding), records, coded.first_corners, candidates,
        firsts, numbers, sizes, corner_numbers,
    )  # fmt: skip
    if failed:
        raise CorruptFileError(f"section ORDR holds an order that does not fit section CONN, at its byte {coding.byte}")
    return sizes, corner_numbers


def common_size(sizes: Int32Array) -> int:
    """The size of all polygons, or 0 where they differ."""
    return int(sizes[0]) if sizes.size and bool((sizes == sizes[0]).all()) else 0
