"""Grids of XDMF as steps in time: temporal collections of grids, which may be of several parts, and their times.

By XDMF's model a grid is uniform (a mesh), a collection of grids, temporal or spatial, or a tree of them. Parts of a
spatial collection are there at once; so are grids of a domain without a temporal collection.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from pdecodec.errors import InputError, damaged
from pdecodec.formats.vtk.motion import quoted
from pdecodec.formats.vtk.xdmf_document import Document, Element
from pdecodec.formats.vtk.xdmf_items import Items

MOST_GRIDS = 2**22
"""Grids of a file: includes of includes can multiply a few lines to any number."""


@dataclass(frozen=True)
class Part:
    """A uniform grid.

    Attributes
    ----------
    name : str
    geometry, topology : Element
    attributes, sets : tuple of Element
    """

    name: str
    geometry: Element
    topology: Element
    attributes: tuple[Element, ...] = ()
    sets: tuple[Element, ...] = ()


@dataclass(frozen=True)
class Step:
    """The parts that are there at a time; None where the file does not say when."""

    time: float | None
    parts: tuple[Part, ...]


@dataclass
class Timeline:
    """Steps of a document, and what of it is not among them."""

    steps: list[Step]
    notices: list[str] = field(default_factory=list)
    others: list[Step] = field(default_factory=list)


class Grids:
    """Grids of a document.

    Raises
    ------
    InputError
        If a grid is of a kind that is not read, or lacks geometry, topology or time.
    """

    def __init__(self, document: Document, items: Items) -> None:
        self._document, self._items, self._path = document, items, document.path
        self._count = 0
        self.loose: list[Element] = []  # attributes of collections themselves

    def timeline(self, wanted: str | None) -> Timeline:
        """Return the steps of the domain; of several temporal collections those of the first, or of the first with an
        attribute of the name `wanted`.
        """
        domains = self._document.root.findall("Domain")
        if self._document.root.tag != "Xdmf" or not domains:
            raise damaged("holds no domain of XDMF; write it again", path=self._path)
        grids = self._document.children(domains[0], "Grid")
        if not grids:
            raise damaged("holds no grid; write it again", path=self._path)
        read = [(grid, self._steps(grid, None)) for grid in grids if _collection(grid) == "temporal"]
        lost = [f"only the first of {len(domains)} domains is read"] if len(domains) > 1 else []
        if not read:
            name = f"of {len(grids)} grids of the domain"
            return Timeline(self._together([self._steps(grid, None) for grid in grids], None, name), lost)
        chosen = next((one for one in read if _has(one[1], wanted)), read[0])
        rest = [one for one in read if one is not chosen]
        if rest:
            names = quoted(grid.get("Name", "") for grid, _ in rest)
            lost.append(f"of {len(read)} temporal collections {chosen[0].get('Name', '')!r} is read, not {names}")
        used = {part.geometry for _, steps in read for step in steps for part in step.parts}
        beside = [
            grid.get("Name", "")
            for grid in grids
            if _collection(grid) != "temporal" and not used & set(grid.iter("Geometry"))
        ]
        if beside:
            lost.append(f"grids beside the temporal collection are not read: {quoted(beside)}")
        return Timeline(chosen[1], lost, [step for _, steps in rest for step in steps])

    def _steps(self, grid: Element, inherited: float | None) -> list[Step]:
        """Return the steps of a grid: those of a temporal collection, else one, at its time or the one above it."""
        self._count += 1
        if self._count > MOST_GRIDS:
            raise InputError(f"holds more than {MOST_GRIDS:,} grids", code="too-large", path=self._path)
        kind, name = _collection(grid), grid.get("Name", "")
        if kind == "uniform":
            return [Step(self._own_time(grid, inherited), (self._part(grid),))]
        children = self._document.children(grid, "Grid")
        if not children:
            raise damaged(f"the {kind} collection {name!r} holds no grid; write it again", path=self._path)
        self.loose += self._document.children(grid, "Attribute")
        if kind == "temporal":
            return self._in_time(grid, children)
        time = self._own_time(grid, inherited)
        return self._together([self._steps(child, time) for child in children], time, f"of the {kind} grid {name!r}")

    def _in_time(self, grid: Element, children: Sequence[Element]) -> list[Step]:
        """Return the steps of a temporal collection: times are those of its grids, or its own list of them."""
        name = grid.get("Name", "")
        steps: list[Step] = []
        for child in children:
            found = self._steps(child, None)
            if len(found) != 1:
                raise InputError(
                    f"the temporal collection {name!r} holds another one, which is not read",
                    code="unsupported-feature",
                    path=self._path,
                )
            steps += found
        known = [step.time is not None for step in steps]
        if all(known):
            return steps
        if any(known):
            raise InputError(
                f"grid {known.index(False)} of the temporal collection {name!r} has no time, and others have",
                code="invalid-times",
                path=self._path,
                frame=known.index(False),
            )
        listed = self._times(grid)
        if listed is None:
            return steps
        if len(listed) != len(steps):
            raise damaged(
                f"the temporal collection {name!r} has {len(listed)} times and {len(steps)} grids; write it again",
                path=self._path,
            )
        return [Step(time, step.parts) for time, step in zip(listed, steps, strict=True)]

    def _together(self, groups: list[list[Step]], time: float | None, where: str) -> list[Step]:
        """Return the steps of grids that are there at once."""
        counts = {len(steps) for steps in groups}
        if len(counts) > 1:
            raise InputError(
                f"the parts {where} have {sorted(counts)} steps; write as many of each",
                code="damaged-input",
                path=self._path,
            )
        joined = []
        for steps in zip(*groups, strict=True):
            times = {step.time for step in steps if step.time is not None}
            if len(times) > 1:
                listed = ", ".join(f"{one:g}" for one in sorted(times))
                raise InputError(
                    f"the parts {where} have different times ({listed}); put them into a temporal collection",
                    code="invalid-times",
                    path=self._path,
                )
            joined.append(Step(times.pop() if times else time, tuple(part for step in steps for part in step.parts)))
        return joined

    def information(self) -> dict[str, dict[str, None]]:
        """Return the names of what the document says in elements of that kind."""
        names = dict.fromkeys(str(one.get("Name")) for one in self._document.root.iter("Information"))
        return {"information": names} if names else {}

    def _part(self, grid: Element) -> Part:
        name = grid.get("Name", "")
        geometry, topology = (self._document.child(grid, tag) for tag in ("Geometry", "Topology"))
        if geometry is None or topology is None:
            tag = "geometry" if geometry is None else "topology"
            raise damaged(
                f"grid {name!r} has no {tag}, and neither includes one nor refers to one; write it again",
                path=self._path,
            )
        attributes, sets = (tuple(self._document.children(grid, tag)) for tag in ("Attribute", "Set"))
        return Part(name, geometry, topology, attributes, sets)

    def _own_time(self, grid: Element, inherited: float | None) -> float | None:
        """Return the time of a grid that is no temporal collection; of a range, where it begins."""
        times = self._times(grid)
        if times is None:
            return inherited
        if len(times) != 1:
            raise InputError(
                f"grid {grid.get('Name', '')!r} has {len(times)} times, and may have one",
                code="invalid-times",
                path=self._path,
            )
        return times[0]

    def _times(self, grid: Element) -> list[float] | None:
        """Return the times that a grid tells of itself or of its children; None where it tells none."""
        time = self._document.child(grid, "Time")
        if time is None:
            return None
        kind, name = time.get("TimeType", time.get("Type", "Single")).lower(), grid.get("Name", "")
        numbers: list[float]
        if kind == "single" and time.get("Value") is not None:
            numbers = [float(str(time.get("Value")))]
        elif kind in ("list", "hyperslab", "range", "single"):
            stored = time.get("Value") or (time.text or "").strip()
            values = self._items.only(time) if self._items.of(time) else np.array(stored.split(), np.float64)
            numbers = values.reshape(-1).astype(np.float64).tolist()
        else:
            raise InputError(
                f"times of type {kind} of grid {name!r} are not read; list them",
                code="unsupported-feature",
                path=self._path,
            )
        if kind == "hyperslab":
            if len(numbers) != 3 or not 0 <= numbers[2] <= MOST_GRIDS:
                raise InputError(
                    f"times of grid {name!r} are no start, stride and count", code="invalid-times", path=self._path
                )
            numbers = [numbers[0] + numbers[1] * step for step in range(int(numbers[2]))]
        elif kind == "range":
            if _collection(grid) == "temporal" and len(self._document.children(grid, "Grid")) > 1:
                raise InputError(
                    f"the time of the temporal collection {name!r} is a range, which does not say when each of its "
                    "grids is; list their times",
                    code="invalid-times",
                    path=self._path,
                )
            numbers = numbers[:1]
        return numbers


def _collection(grid: Element) -> str:
    """Return ``uniform``, ``temporal``, ``spatial`` or ``tree``."""
    kind = grid.get("GridType", grid.get("Type", "Uniform")).lower()
    if kind == "collection":
        kind = grid.get("CollectionType", grid.get("Collection", "Spatial")).lower()
    if kind not in ("uniform", "temporal", "spatial", "tree"):
        raise InputError(
            f"grid {grid.get('Name', '')!r} is of type {kind}, which is not read; write uniform grids",
            code="unsupported-feature",
        )
    return kind


def _has(steps: Sequence[Step], name: str | None) -> bool:
    found: Iterator[Element] = (one for part in steps[0].parts for one in part.attributes)
    return any(one.get("Name", "") == name for one in found)
