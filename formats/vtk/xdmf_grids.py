"""Find the time steps of an XDMF document: temporal collections of grids, the parts of each step, and times.

In XDMF a grid is uniform (a mesh), a temporal or spatial collection of grids, or a tree of grids. The parts of a
spatial collection exist together, and so do the grids of a domain without a temporal collection.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pdecodec.errors import InputError, damaged
from pdecodec.formats.vtk.motion import quoted
from pdecodec.formats.vtk.xdmf_document import Document, Element
from pdecodec.formats.vtk.xdmf_items import Items

MAX_GRIDS = 2**22
"""Largest number of grids in a file: nested includes can multiply a few lines without limit."""


@dataclass(frozen=True)
class Part:
    """A uniform grid of XDMF: one mesh.

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
    """The parts of a time step; its time is None if the file does not state it."""

    time: float | None
    parts: tuple[Part, ...]


@dataclass
class Timeline:
    """The time steps that are read from a document, notices about all other grids, and the steps of other
    collections.
    """

    steps: list[Step]
    notices: list[str] = field(default_factory=list)
    others: list[Step] = field(default_factory=list)


class Grids:
    """Grids of a document.

    Raises
    ------
    InputError
        If a grid is of an unsupported kind, or lacks geometry, topology or time.
    """

    def __init__(self, document: Document, items: Items) -> None:
        self._document, self._items, self._path = document, items, document.path
        self._count = 0
        self.loose: list[Element] = []  # attributes of the collections themselves

    def timeline(self, wanted: str | None) -> Timeline:
        """Return the steps of the first domain.

        Of several temporal collections it takes the first with an attribute named `wanted`, else the first.
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
            return Timeline(self._join_steps([self._steps(grid, None) for grid in grids], None, name), lost)
        chosen = next((one for one in read if _has_attribute(one[1], wanted)), read[0])
        rest, steps = [], chosen[1]
        for one in read:
            whole = None if one is chosen else self._with_attributes(steps, one[1])
            steps = whole or steps
            rest += [one] if one is not chosen and whole is None else []
        if rest:
            names = quoted(grid.get("Name", "") for grid, _ in rest)
            lost.append(f"of {len(read)} temporal collections {chosen[0].get('Name', '')!r} is read, not {names}")
        used = {part.geometry for _, steps in read for step in steps for part in step.parts}
        outside = [
            grid.get("Name", "")
            for grid in grids
            if _collection(grid) != "temporal" and not used & set(grid.iter("Geometry"))
        ]
        if outside:
            lost.append(f"grids outside the temporal collection are not read: {quoted(outside)}")
        return Timeline(steps, lost, [step for _, others in rest for step in others])

    def _with_attributes(self, steps: Sequence[Step], others: Sequence[Step]) -> list[Step] | None:
        """Return steps with the attributes of other steps added; None unless these have the same times and
        meshes.

        Programs of finite elements write a temporal collection for each function.
        """
        if [step.time for step in steps] != [step.time for step in others]:
            return None
        found = []
        for step, other in zip(steps, others, strict=True):
            if len(step.parts) != len(other.parts):
                return None
            pairs = list(zip(step.parts, other.parts, strict=True))
            if not all(
                self._is_same(a.geometry, b.geometry) and self._is_same(a.topology, b.topology) for a, b in pairs
            ):
                return None
            parts = (replace(a, attributes=(*a.attributes, *b.attributes), sets=(*a.sets, *b.sets)) for a, b in pairs)
            found.append(Step(step.time, tuple(parts)))
        return found

    def _is_same(self, mine: Element, other: Element) -> bool:
        """Return whether two elements refer to the same data, without reading the data."""
        return mine is other or (mine.attrib == other.attrib and self._items.key(mine) == self._items.key(other))

    def _steps(self, grid: Element, inherited: float | None) -> list[Step]:
        """Return the steps of a grid: those of a temporal collection, else one, with its own or the inherited time."""
        self._count += 1
        if self._count > MAX_GRIDS:
            raise InputError(f"holds more than {MAX_GRIDS:,} grids", code="too-large", path=self._path)
        kind, name = _collection(grid), grid.get("Name", "")
        if kind == "uniform":
            return [Step(self._own_time(grid, inherited), (self._part(grid),))]
        children = self._document.children(grid, "Grid")
        if not children:
            raise damaged(f"the {kind} collection {name!r} holds no grid; write it again", path=self._path)
        self.loose += self._document.children(grid, "Attribute")
        if kind == "temporal":
            return self._collection_steps(grid, children)
        time = self._own_time(grid, inherited)
        return self._join_steps([self._steps(child, time) for child in children], time, f"of the {kind} grid {name!r}")

    def _collection_steps(self, grid: Element, children: Sequence[Element]) -> list[Step]:
        """Return the steps of a temporal collection; times come from its grids, or from its own list."""
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
                f"grid {known.index(False)} of the temporal collection {name!r} has no time, but others have one",
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

    def _join_steps(self, groups: list[list[Step]], time: float | None, where: str) -> list[Step]:
        """Join the steps of grids that exist together."""
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
        """Return the names of the document's ``Information`` elements, as data that are not kept."""
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
        """Return the time of a grid that is no temporal collection; of a range, its start."""
        times = self._times(grid)
        if times is None:
            return inherited
        if len(times) != 1:
            raise InputError(
                f"grid {grid.get('Name', '')!r} has {len(times)} times; it may have only one",
                code="invalid-times",
                path=self._path,
            )
        return times[0]

    def _times(self, grid: Element) -> list[float] | None:
        """Return the times that a grid states for itself or its children; None if it states none."""
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
            if len(numbers) != 3 or not 0 <= numbers[2] <= MAX_GRIDS:
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


def _has_attribute(steps: Sequence[Step], name: str | None) -> bool:
    found: Iterator[Element] = (one for part in steps[0].parts for one in part.attributes)
    return any(one.get("Name", "") == name for one in found)
