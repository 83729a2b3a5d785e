"""Sections 5 and 6 of the specification: CONN and ORDR."""

from __future__ import annotations

from spec.decoder.contexts import Contexts, MatchModel
from spec.decoder.fields import require
from spec.decoder.mesh import Mesh
from spec.decoder.order import OrderModel, OrderReader, read_members
from spec.decoder.surface import History, SurfaceReader

SMALLEST = {"faces": 3, "lines": 1}

Polygons = list[list[int]]


def read_faces_and_lines(conn: bytes, ordr: bytes, meshes: list[Mesh]) -> None:
    """Fill in the faces and lines of `meshes`."""
    contexts, orders = Contexts(conn), Contexts(ordr)
    history, model = History(), OrderModel(orders)
    matches = {kind: MatchModel(contexts, kind) for kind in SMALLEST}
    any_order = False
    for mesh in meshes:
        for kind in SMALLEST:
            count, size, corners = read_head(contexts, kind)
            if count and kind == "faces" and contexts.bit("surface"):
                has_border = bool(contexts.bit("has border"))
                has_order = bool(contexts.bit("has order"))
                surface = SurfaceReader(contexts, history, size, has_border).read(count, corners, mesh.vertices)
                if has_order:
                    any_order = True
                    used = read_members(orders, len(surface.borders), mesh.vertices)
                    polygons = [[used[number] for number in face] for face in OrderReader(model, surface).read()]
                else:
                    polygons = [[side.vertex for side in face] for face in surface.faces]
            else:
                polygons = read_polygons(contexts, matches[kind], kind, (count, size, corners), mesh.vertices)
            if kind == "faces":
                mesh.faces = polygons
            else:
                mesh.lines = polygons
    contexts.finish()
    orders.finish()
    require(any_order or not ordr, "an order of nothing")


def read_head(contexts: Contexts, kind: str) -> tuple[int, int, int]:
    """5.1: number of polygons, common size or 0, corners."""
    count = contexts.number(kind, "count")
    if count == 0:
        return 0, 0, 0
    size = contexts.number(kind, "size")
    require(size == 0 or size >= SMALLEST[kind], "polygons of too few corners")
    corners = count * size if size else contexts.number(kind, "corners")
    require(SMALLEST[kind] * count <= corners < 2**31, "polygons of too few corners, or too many")
    return count, size, corners


def read_polygons(
    contexts: Contexts, matches: MatchModel, kind: str, head: tuple[int, int, int], vertices: int
) -> Polygons:
    """5.2: polygons in their order."""
    count, common, corners = head
    polygons: Polygons = []
    highest, first, recent = -1, 0, 0
    for left in range(count - 1, -1, -1):
        size = common
        if common == 0:
            matched = matches.read(4)
            size = SMALLEST[kind] + contexts.number(kind, "larger by") if matched is None else matched
            matches.add(size)
        corners -= size
        require(size >= SMALLEST[kind] and corners >= SMALLEST[kind] * left, "a polygon that does not fit")
        polygon: list[int] = []
        for place in range(size):
            phase = min(place, 3)
            before = polygon[-1] if polygon else first
            difference = matches.read(phase)
            if difference is None:
                new = contexts.bit(kind, "new", phase, recent)
                recent = (2 * recent + new) % 32
                difference = highest + 1 - before if new else contexts.signed(kind, "difference", phase)
            matches.add(difference)
            vertex = before + difference
            require(0 <= vertex < vertices, "a vertex that is not there")
            polygon.append(vertex)
            highest = max(highest, vertex)
        first = polygon[0]
        polygons.append(polygon)
    require(corners == 0, "polygons of too few corners")
    return polygons
