"""Section 17.2 of the specification: which elements around a point have the same value."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

from spec.decoder.contexts import Contexts
from spec.decoder.polygons import NOTHING, Corner, Polygons

MOST_CORNERS = 16
BESIDE_BEFORE, BESIDE_AFTER, AROUND, LATEST = range(4)
NORMAL_BITS = 12
EDGE_BITS = 16

Vector = list[int]


class CornerTable(Polygons):
    """Polygons with the corners across their edges."""

    def opposite(self, corner: Corner) -> Corner | None:
        """The corner whose edge lies on the edge of a corner."""
        return self._opposites.get(corner)

    def across(self, edge: Corner, vertex: int) -> tuple[Corner | None, Corner | None]:
        """The corner at `vertex` across an edge, and the one at the edge's other end."""
        opposite = self.opposite(edge)
        if opposite is None:
            return None, None
        pair = opposite, self.next(opposite)
        return pair if self.vertex(opposite) == vertex else pair[::-1]


@dataclass
class Elements:
    """What has values: how many there are, and which corners are theirs."""

    count: int
    of_corner: dict[Corner, int]
    _corners: dict[int, list[Corner]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        for corner, element in sorted(self.of_corner.items()):
            self._corners.setdefault(element, []).append(corner)

    def corners(self, element: int) -> list[Corner]:
        """The corners of an element: none of objects, whose number alone takes no memory."""
        return self._corners.get(element, [])


class WedgeReader:
    """Reads wedges; the history of comparisons goes on from attribute to attribute."""

    def __init__(self, contexts: Contexts, name: str) -> None:
        self._contexts = contexts
        self._name = name
        self._history = 0

    def read(
        self,
        table: CornerTable,
        normals: list[Vector],
        elements: Elements,
        earlier: dict[Corner, int] | None,
        *,
        has_runs: bool,
    ) -> list[int]:
        """The wedge of every element."""
        found: list[int] = []
        wedges = 0
        for element in range(elements.count):
            self._contexts.check_not_ended()
            refused: set[int] = set()
            wedge = NOTHING
            for corner in elements.corners(element)[:MOST_CORNERS]:
                wedge = self._compare(table, normals, elements, earlier, found, corner, refused)
                if wedge != NOTHING:
                    break
            is_run = wedge == NOTHING and has_runs and found and found[-1] not in refused
            if is_run and self._is_same(LATEST, 0, 0, len(refused), 0, 0):
                wedge = found[-1]
            if wedge == NOTHING:
                wedge = wedges
                wedges += 1
            found.append(wedge)
        return found

    def _compare(
        self,
        table: CornerTable,
        normals: list[Vector],
        elements: Elements,
        earlier: dict[Corner, int] | None,
        found: list[int],
        corner: Corner,
        refused: set[int],
    ) -> int:
        """Compare an element with the wedges at one of its corners."""

        def wedge_at(place: Corner | None) -> int:
            element = elements.of_corner.get(place, NOTHING) if place else NOTHING
            return found[element] if 0 <= element < len(found) else NOTHING

        point = table.vertex(corner)
        before, after = table.previous(corner), table.next(corner)
        one, one_end = table.across(before, point)
        other, other_end = table.across(corner, point)
        agreement = likeness(wedge_at(one), wedge_at(other))
        around = [(AROUND, each, 0) for each in table.corners[point][:MOST_CORNERS]]
        for kind, beside, ends in (
            (BESIDE_BEFORE, one, likeness(wedge_at(before), wedge_at(one_end))),
            (BESIDE_AFTER, other, likeness(wedge_at(after), wedge_at(other_end))),
            *around,
        ):
            wedge = wedge_at(beside)
            if beside is None or wedge == NOTHING or wedge in refused:
                continue
            bend = bend_of(normals[corner[0]], normals[beside[0]]) if kind != AROUND else 0
            seam = 0
            if earlier is not None:
                seam = 1 if earlier.get(beside) == earlier.get(corner) else 2
            if self._is_same(kind, ends, agreement, len(refused), bend, seam):
                return wedge
            refused.add(wedge)
        return NOTHING

    def _is_same(self, kind: int, ends: int, agreement: int, refused: int, bend: int, seam: int) -> int:
        bit = self._contexts.mixed(
            (self._name, "same", kind),
            (ends, agreement, min(refused, 2)),
            (bend, ends, seam),
            (self._history, seam),
        )
        self._history = (2 * self._history + bit) % 256
        return bit


def likeness(one: int, other: int) -> int:
    """0 where one is not known, 1 for the same, 2 for others."""
    return 0 if NOTHING in (one, other) else 1 if one == other else 2


def normal_of(polygon: list[Vector]) -> Vector:
    """A normal of a polygon, its largest component brought to 12 binary digits."""
    origin = polygon[0]
    edges = [[x - y for x, y in zip(point, origin, strict=True)] for point in polygon]
    shift = max(max(abs(x) for edge in edges for x in edge).bit_length() - EDGE_BITS, 0)
    edges = [[x >> shift for x in edge] for edge in edges]
    normal = [0, 0, 0]
    for u, w in pairwise(edges[1:]):
        normal = [n + u[k - 2] * w[k - 1] - u[k - 1] * w[k - 2] for k, n in enumerate(normal)]
    shift = max(max(abs(n) for n in normal).bit_length() - NORMAL_BITS, 0)
    return [n >> shift for n in normal]


def bend_of(one: Vector, other: Vector) -> int:
    """How flat two polygons lie to each other: 0 unknown, 1 at 90 degrees or more, up to 7 flat."""
    dot = sum(a * b for a, b in zip(one, other, strict=True))
    squares = sum(a * a for a in one) * sum(b * b for b in other)
    if squares == 0 or dot <= 0:
        return int(squares > 0)
    return min(1 + (squares // max(squares - dot * dot, 1)).bit_length(), 7)
