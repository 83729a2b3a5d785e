"""Sections CONN and ORDR: faces and lines of every object, and the order that surfaces had.

The faces of an object are coded in one of two ways, whichever costs less: as a *surface*, grown across its sides, with
the order of its faces and vertices apart; or as *polygons* in their order, better where a program numbered them
row by row. Lines are polygons. The coder is native: `core/sections/connectivity/`.
"""

from __future__ import annotations

from collections.abc import Sequence

from pdecodec import _core
from pdecodec.codec.sections.bytestream import FieldWriter
from pdecodec.errors import InputError
from pdecodec.mesh.sequence import Connectivity

MOST_CORNERS = 2**31 - 1
"""Face corners of an object, and points of its lines: they are numbered by int32."""


CodedOrder = _core.CodedOrder
"""The order in which an object's surface is coded: of each vertex, face and corner, its number in the source."""


def encode_connectivity(parts: Sequence[Connectivity], *, keep_order: bool = True) -> tuple[bytes, bytes]:
    """Sections CONN and ORDR: the connectivity of every object, in order.

    Parameters
    ----------
    parts : sequence of Connectivity
    keep_order : bool
        Otherwise surfaces that stand in the order of their coding (:func:`coded_orders`) leave it out.

    Returns
    -------
    conn : bytes
        Vertices, faces and lines; those of a surface in the coder's order.
    ordr : bytes
        The order that vertices and faces of surfaces had; empty where there is none to restore.

    Raises
    ------
    InputError
        If an object has more than MOST_CORNERS corners.
    """
    head = FieldWriter()
    for count in (len(parts), *(part.vertex_count for part in parts)):
        head.count(count)
    coded = _core.encode_connectivity(core_parts(parts), keep_order)
    return head.to_bytes() + coded.conn, coded.ordr


def coded_orders(parts: Sequence[Connectivity]) -> list[CodedOrder | None]:
    """The order in which each object's faces are coded where nothing is to be restored; None where it is its own."""
    return _core.coded_orders(core_parts(parts))


def core_parts(parts: Sequence[Connectivity]) -> list[_core.Part]:
    """Connectivity of objects as the native core takes it; InputError where one has more corners than it numbers."""
    for part in parts:
        if max(part.face_indices.size, part.line_indices.size) > MOST_CORNERS:
            raise InputError(f"an object has more than {MOST_CORNERS} face corners; split it", code="too-large")
    return [
        (part.vertex_count, part.face_counts, part.face_indices, part.line_counts, part.line_indices) for part in parts
    ]
