"""Sections CONN, ORDR and SOLD: faces, lines and cells of every object, and the original order of surfaces.

The faces of an object are coded in one of two ways, whichever costs less. As a *surface*, they are grown across the
sides of known faces, and the order of faces and vertices is coded separately. As *polygons*, they keep their order,
which is better if a program numbered them row by row. Lines are coded as polygons. The coder is native:
`core/sections/connectivity/`.
"""

from __future__ import annotations

from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np

from pdecodec import _core
from pdecodec.codec.sections.bytestream import FieldWriter
from pdecodec.errors import InputError
from pdecodec.mesh.sequence import Connectivity, MeshObject

MAX_CORNERS = 2**31 - 1
"""Largest number of face corners, and of line points, of an object, because they are numbered by int32."""


CodedOrder = _core.CodedOrder
"""The order in which an object's surface is coded: the source number of each vertex, face and corner."""


def encode_connectivity(parts: Sequence[Connectivity], *, keep_order: bool = True) -> tuple[bytes, bytes]:
    """Return sections CONN and ORDR: the connectivity of every object, in order.

    Parameters
    ----------
    parts : sequence of Connectivity
    keep_order : bool
        If False, leave out ORDR; surfaces must then be in the order of :func:`coded_orders`.

    Returns
    -------
    conn : bytes
        Vertices, faces and lines; those of a surface in the coder's order.
    ordr : bytes
        The original order of the vertices and faces of surfaces; empty if there is no order to restore.

    Raises
    ------
    InputError
        If an object has more than MAX_CORNERS corners.
    """
    head = FieldWriter()
    for count in (len(parts), *(part.vertex_count for part in parts)):
        head.count(count)
    coded = _core.encode_connectivity(core_parts(parts), keep_order)
    return head.to_bytes() + coded.conn, coded.ordr


def coded_orders(parts: Sequence[Connectivity]) -> list[CodedOrder | None]:
    """Return the order in which each object's faces are coded if no order is kept; None for an object that
    keeps its order.
    """
    return _core.coded_orders(core_parts(parts))


def core_parts(parts: Sequence[Connectivity]) -> list[_core.Part]:
    """Return the connectivity of objects in the form that the core takes; raise InputError if an object has
    more corners than int32 can number.
    """
    for part in parts:
        if max(part.face_indices.size, part.line_indices.size, part.cell_indices.size) > MAX_CORNERS:
            raise InputError(f"an object has more than {MAX_CORNERS} face corners; split it", code="too-large")
    return [
        (part.vertex_count, part.face_counts, part.face_indices, part.line_counts, part.line_indices,
         part.cell_shapes, part.cell_counts, part.cell_indices)
        for part in parts
    ]  # fmt: skip


def encode_cells(parts: Sequence[Connectivity]) -> bytes:
    """Return section SOLD: the cells of every object; empty if there are none."""
    return _core.encode_cells(core_parts(parts))


_with_inner_sides: WeakKeyDictionary[Connectivity, Connectivity] = WeakKeyDictionary()
"""Cache of :func:`predicted_on`; it keeps no mesh in memory."""


def predicted_on(objects: Sequence[MeshObject]) -> list[Connectivity]:
    """Return the connectivity that positions are predicted on: inner sides of solids follow an object's own faces."""
    return [_predicted_on(item.connectivity) for item in objects]


def _predicted_on(part: Connectivity) -> Connectivity:
    if not part.cell_count:
        return part
    found = _with_inner_sides.get(part)
    if found is None:
        counts, indices = _core.inner_sides(core_parts([part]))
        found = _with_inner_sides[part] = Connectivity(
            part.vertex_count,
            np.concatenate([part.face_counts, counts]),
            np.concatenate([part.face_indices, indices]),
            part.line_counts,
            part.line_indices,
        )
    return found
