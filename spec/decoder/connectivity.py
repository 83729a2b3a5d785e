"""Section 29 of the specification: CONN and ORDR of version 2."""

from __future__ import annotations

from spec.decoder.contexts import Contexts, Memory
from spec.decoder.fields import require
from spec.decoder.mesh import Mesh
from spec.decoder.order import OrderModel, OrderReader, read_runs
from spec.decoder.surface import History, SurfaceReader

Polygons = list[list[int]]


def read_faces_and_lines(conn: bytes, ordr: bytes, meshes: list[Mesh]) -> None:
    """Fill in the faces and lines of `meshes`."""
    contexts, orders = Contexts(conn), Contexts(ordr)
    history, model = History(), OrderModel(orders)
    memories = {kind: Memory(contexts, kind) for kind in ("faces", "lines")}
    any_surface = False
    for mesh in meshes:
        kinds = []
        for kind, smallest in (("faces", 3), ("lines", 1)):
            count, size, corners = _read_head(contexts, kind, smallest)
            if count and kind == "faces" and contexts.bit("surface"):
                any_surface = True
                has_border = bool(contexts.bit("has border"))
                surface = SurfaceReader(contexts, history, size, has_border).read(count, corners, mesh.vertices)
                used = read_runs(orders, len(surface.borders), mesh.vertices)
                faces = OrderReader(model, surface).read()
                kinds.append([[used[number] for number in face] for face in faces])
            else:
                memory = memories[kind]
                kinds.append(_read_polygons(contexts, memory, kind, smallest, count, size, corners, mesh.vertices))
        mesh.faces, mesh.lines = kinds
    require(contexts.is_finished() and orders.is_finished(), "a section has bytes too many, or too few")
    require(any_surface or not ordr, "an order of nothing")


def _read_head(contexts: Contexts, kind: str, smallest: int) -> tuple[int, int, int]:
    """Section 29.2: number of polygons, common size or 0, corners."""
    count = contexts.number(kind, "count")
    if count == 0:
        return 0, 0, 0
    size = contexts.number(kind, "size")
    require(size == 0 or size >= smallest, "polygons of too few corners")
    corners = count * size if size else contexts.number(kind, "corners")
    require(smallest * count <= corners < 2**31, "polygons of too few corners, or too many")
    return count, size, corners


def _read_polygons(
    contexts: Contexts, memory: Memory, kind: str, smallest: int, count: int, common: int, corners: int, vertices: int
) -> Polygons:
    """Section 29.3: polygons in their order."""
    polygons: Polygons = []
    highest = -1
    first = 0
    recent = 0
    for left in range(count - 1, -1, -1):
        size = common
        if common == 0:
            remembered = memory.read(4)
            size = smallest + contexts.number(kind, "larger by") if remembered is None else remembered
            memory.add(size)
        require(smallest <= size <= corners - smallest * left, "a polygon that does not fit")
        corners -= size
        polygon: list[int] = []
        for place in range(size):
            phase = min(place, 3)
            before = polygon[-1] if polygon else first
            difference = memory.read(phase)
            if difference is None:
                new = contexts.bit(kind, "new", phase, recent)
                recent = (2 * recent + new) % 32
                difference = highest + 1 - before if new else contexts.signed(kind, "difference", phase)
            memory.add(difference)
            vertex = before + difference
            require(0 <= vertex < vertices, "a vertex that is not there")
            polygon.append(vertex)
            highest = max(highest, vertex)
        first = polygon[0]
        polygons.append(polygon)
    require(corners == 0, "polygons of too few corners")
    return polygons
