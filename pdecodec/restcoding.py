"""Coding of the rest shape in format version 2: predicted across the faces, or along the curves as in version 1.

Vertices that lie on the same point may be welded for the purpose: seams and soups of polygons then have a surface to
predict across. The encoder takes what is smallest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.curves import extract_curves
from pdecodec.errors import CorruptFileError
from pdecodec.polygons import Polygons, polygons_of
from pdecodec.quantise import LARGEST_STEP
from pdecodec.restshape import PREDICTORS, RestShape, decode_rest_along_curves, encode_rest_along_curves
from pdecodec.sequence import MeshObject

if TYPE_CHECKING:
    from pdecodec.kernels.facewalk import Corners

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

ACROSS_FACES, ACROSS_WELDED_FACES = 3, 4
"""Predictors beside those along curves."""

HEADER_BYTES = 33
"""Step, origin, predictor."""

FIRST_WEIGHT = 2**16 // 3
"""Of each of three opinions in a mix, in 1/65536, before anything is learnt."""

FIRST_ROOM = 12
"""Bytes a vertex that are set aside for the coded levels at first; what does not fit is coded again with room."""


def encode_rest(shape: RestShape, objects: Sequence[MeshObject]) -> bytes:
    """Section REST, with the predictor that makes it smallest.

    Parameters
    ----------
    shape : RestShape
    objects : sequence of MeshObject
        Whose vertices `shape` has, one object after the other.
    """
    mesh = polygons_of(objects)
    point_of = _shared_points(shape.levels, mesh.vertex)
    candidates = [
        encode_rest_along_curves(shape, extract_curves(objects)),
        _header(shape, ACROSS_FACES) + _encode_across(shape.levels, mesh, None),
    ]
    if point_of is not None:
        candidates.append(_header(shape, ACROSS_WELDED_FACES) + _encode_across(shape.levels, mesh, point_of))
    return min(candidates, key=len)


def decode_rest(data: bytes, objects: Sequence[MeshObject]) -> RestShape:
    """Undo :func:`encode_rest`; reads sections of version 1 as well.

    Raises
    ------
    CorruptFileError
        If the section is damaged or a coordinate is out of range.
    """
    reader = FieldReader(data, "REST")
    step, *origin = reader.reals("dddd")
    (predictor,) = reader.integers("B")
    if predictor in PREDICTORS:
        return decode_rest_along_curves(data, extract_curves(objects))
    if predictor not in (ACROSS_FACES, ACROSS_WELDED_FACES):
        raise CorruptFileError(f"section REST names predictor {predictor}, this decoder knows 1 to 4")
    if not 0 < step <= LARGEST_STEP or max(map(abs, origin)) > LARGEST_STEP:
        raise CorruptFileError("section REST has a quantisation step or an origin out of range")
    levels = _decode_across(data[HEADER_BYTES:], polygons_of(objects), is_welded=predictor == ACROSS_WELDED_FACES)
    return RestShape(levels, np.array(origin), step)


def _header(shape: RestShape, predictor: int) -> bytes:
    writer = FieldWriter()
    writer.numbers("ddddB", shape.step, *shape.origin.tolist(), predictor)
    return writer.to_bytes()


def _shared_points(levels: Int64Array, corner_vertex: Int32Array) -> Int32Array | None:
    """Point of each vertex, numbered as the corners and then the other vertices meet them; None if none is shared."""
    order = np.lexsort(levels.T)
    differs = np.append(True, np.diff(levels[order], axis=0).any(axis=1))
    if differs.all():
        return None
    place = np.empty(len(levels), np.int64)
    place[order] = np.cumsum(differs) - 1
    met = place[np.concatenate([corner_vertex, np.arange(len(levels), dtype=np.int32)])]
    first_met = np.empty(int(place.max()) + 1, np.int64)
    first_met[met[::-1]] = np.arange(met.size)[::-1]  # of equal indices the last one counts
    number = np.empty(first_met.size, np.int32)
    number[np.argsort(first_met)] = np.arange(first_met.size, dtype=np.int32)
    shared: Int32Array = number[place]
    return shared


def _encode_across(levels: Int64Array, mesh: Polygons, point_of: Int32Array | None) -> bytes:
    from pdecodec.kernels.facepredict import CLASS, ROWS_OF_FINDINGS, look_around_all, new_points
    from pdecodec.kernels.facewalk import link_corners, stencils, walk
    from pdecodec.kernels.rangecoder import ENCODE, finish, new_coder
    from pdecodec.resthints import choose_hint_weights

    corners = link_corners(*mesh)
    surface = corners
    if point_of is not None:
        points = int(point_of.max()) + 1
        by_point = np.empty((points, 3), np.int64)
        by_point[point_of] = levels
        levels = by_point
        surface = link_corners(mesh.starts, point_of[mesh.vertex], mesh.faces, points)
    order, found = walk(surface), stencils(surface)
    findings = np.zeros((len(levels), ROWS_OF_FINDINGS, 3), np.int64)
    numbers = np.zeros((len(levels), 3), np.int64)
    look_around_all(order, new_points(levels), surface.fan_starts, found, findings, numbers)
    hint_weights = choose_hint_weights(levels, findings, numbers[:, CLASS])
    room = FIRST_ROOM * mesh.vertices + 64
    while True:
        data = np.zeros(room, np.uint8)
        coder = new_coder(ENCODE)
        if point_of is not None:
            _code_welds(coder, data, corners, point_of)
        _code_points(coder, data, order, levels, surface.fan_starts, found, hint_weights)
        size = finish(coder, data)
        if size <= room:
            return data[:size].tobytes()
        room = size


def _decode_across(content: bytes, mesh: Polygons, *, is_welded: bool) -> Int64Array:
    from pdecodec.kernels.facepredict import CLASSES, HINTS
    from pdecodec.kernels.facewalk import link_corners, stencils, walk
    from pdecodec.kernels.rangecoder import is_finished, new_decoder

    data = np.frombuffer(bytearray(content), np.uint8)
    coder = new_decoder(data)
    surface = link_corners(*mesh)
    point_of = np.zeros(mesh.vertices, np.int32)
    points = mesh.vertices
    if is_welded:
        points = _code_welds(coder, data, surface, point_of)
        if points < 0:
            raise CorruptFileError("section REST welds a vertex to a point that is not there; get the file again")
        surface = link_corners(mesh.starts, point_of[mesh.vertex], mesh.faces, points)
    levels = np.zeros((points, 3), np.int64)
    hint_weights = np.zeros((CLASSES, 2, HINTS), np.int64)
    found = stencils(surface)
    if not _code_points(coder, data, walk(surface), levels, surface.fan_starts, found, hint_weights):
        raise CorruptFileError("section REST has a coordinate out of range; get the file again")
    if not is_finished(coder, data):
        raise CorruptFileError("section REST does not end where its numbers do; get the file again")
    return levels[point_of] if is_welded else levels


def _code_welds(coder: Int64Array, data: UInt8Array, corners: Corners, point_of: Int32Array) -> int:
    from pdecodec.kernels import welding
    from pdecodec.kernels.rangecoder import EVEN

    vertices, size = point_of.size, corners.vertex.size
    scratch = welding.WeldScratch(
        met=np.zeros(vertices, np.bool_),
        latest=np.full(vertices, -1, np.int32),
        earlier=np.zeros(size, np.int32),
        edge_met=np.zeros(size, np.bool_),
        asked=np.full(vertices, -1, np.int32),
        within=np.full(vertices, -1, np.int32),
    )
    cells = np.full(welding.CELLS, EVEN, np.int64)
    return int(welding.code_welds(coder, data, corners, point_of, cells, scratch))


def _code_points(
    coder: Int64Array,
    data: UInt8Array,
    order: Int32Array,
    levels: Int64Array,
    fan_starts: Int64Array,
    stencils: Int32Array,
    hint_weights: Int64Array,
) -> bool:
    from pdecodec.kernels import pointmodel as model
    from pdecodec.kernels.facepredict import new_points
    from pdecodec.kernels.rangecoder import EVEN

    cells = np.full(model.CELLS, EVEN, np.int64)
    mixers = np.full((model.MIXERS, model.OPINIONS), FIRST_WEIGHT, np.int64)
    model.code_hint_weights(coder, data, cells, hint_weights)
    scratch = model.new_scratch()
    points = new_points(levels)
    return bool(
        model.code_points(coder, data, order, points, fan_starts, stencils, hint_weights, cells, mixers, scratch)
    )
