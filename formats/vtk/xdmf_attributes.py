"""Find the fields of an XDMF document: the attributes of its parts on nodes, cells and grids, in every step."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged
from pdecodec.formats.arrays.hdf5 import HDF5_DAMAGE
from pdecodec.formats.base.attribute_roles import unique_name
from pdecodec.formats.base.frame_data import DataKey, on_elements
from pdecodec.formats.vtk.xdmf_document import Element
from pdecodec.formats.vtk.xdmf_grids import Part, Step
from pdecodec.formats.vtk.xdmf_items import Items
from pdecodec.mesh.arrays import Int64Array
from pdecodec.mesh.fields import DTYPES, Field, FieldDomain, missing_value
from pdecodec.mesh.sequence import MeshObject

CENTERS = {"node": "point data", "cell": "cell data", "face": "face data", "edge": "edge data", "grid": "grid data"}
"""Names of an attribute's data in notices, by its Center."""

_DOMAINS: Mapping[str, FieldDomain] = {"node": "vertex", "cell": "face", "grid": "object"}
"""Domains of fields, by Center, unless cells are kept; fields have no place for values on faces and edges of cells."""

MAX_COMPONENTS = 4096
"""Largest number of components of a field: Dimensions that declare more are damaged, or not of these rows."""


@dataclass(frozen=True)
class Rows:
    """Values of one domain that a part stores: how many, which of them are rows of a field, and how many these are."""

    stored: int
    chosen: Int64Array | slice
    count: int


def center_of(attribute: Element) -> str:
    """Return the Center of an attribute, in lower case."""
    return attribute.get("Center", "Node").lower()


def are_degrees_of_freedom(attribute: Element) -> bool:
    """Return whether the values of an attribute belong to functions of finite elements, not to nodes or cells."""
    return attribute.get("ItemType", "") == "FiniteElementFunction"


class AttributeFields:
    """The fields that attributes of the parts of steps form; the parts of every step are in the same order.

    Floats may be missing in some steps, where they are NaN. Whole numbers must be in all steps.

    Parameters
    ----------
    steps : sequence of Step
    rows : sequence of mappings
        For every part the rows of each domain.
    items : Items
    moving : str or None
        Name of the data on nodes that move the mesh, which are no field.

    Attributes
    ----------
    fields : tuple of Field
    kept : dict of (Center, Name)
        The attributes that are read, in order.
    """

    def __init__(
        self, steps: Sequence[Step], rows: Sequence[Mapping[FieldDomain, Rows]], items: Items, moving: str | None
    ) -> None:
        self._steps, self._rows, self._items, self._moving = steps, rows, items, moving
        self._keys: dict[str, DataKey] = {}
        self._domains = _DOMAINS
        if any("cell" in one for one in rows):
            self._domains = {**_DOMAINS, "cell": "cell"}
        self.fields = self._find()
        names = {domain: center for center, domain in self._domains.items()}
        self.kept = dict.fromkeys((names[domain], name) for domain, name in self._keys.values())

    def _of_part(self, number: int, part: Part) -> dict[DataKey, Element]:
        """Return the attributes of a part that have a domain with rows; of the same name, the first."""
        found: dict[DataKey, Element] = {}
        for one in part.attributes:
            domain, name = self._domains.get(center_of(one)), str(one.get("Name"))
            if domain is None or are_degrees_of_freedom(one) or (domain, name) == ("vertex", self._moving):
                continue
            if self._rows[number][domain].count:
                found.setdefault((domain, name), one)
        return found

    def _find(self) -> tuple[Field, ...]:
        kinds: dict[DataKey, set[tuple[np.dtype[Any], int]]] = {}
        counts: dict[DataKey, Counter[int]] = {}
        odd: set[DataKey] = set()
        for step in self._steps:
            for number, part in enumerate(step.parts):
                for key, one in self._of_part(number, part).items():
                    counts.setdefault(key, Counter())[number] += 1
                    try:
                        kinds.setdefault(key, set()).add(self._layout(one, self._rows[number][key[0]].stored))
                    except (InputError, *HDF5_DAMAGE):
                        odd.add(key)
        taken, fields, domains = set[str](), [], list(self._domains.values())
        for key in sorted((one for one in kinds if one not in odd), key=lambda one: domains.index(one[0])):
            dtype, widths = np.result_type(*(dtype for dtype, _ in kinds[key])), {width for _, width in kinds[key]}
            is_whole = all(count == len(self._steps) for count in counts[key].values())
            if dtype not in DTYPES or len(widths) > 1 or not (is_whole or dtype.kind == "f"):
                continue
            domain, name = key
            owners = tuple(sorted(counts[key]))
            able = [number for number, rows in enumerate(self._rows) if rows[domain].count]
            label = unique_name(on_elements(name, domain) if domain != "vertex" and name in taken else name, taken, " ")
            self._keys[label] = key
            fields.append(Field(label, domain, dtype, widths.pop(), "", None if list(owners) == able else owners))
        return tuple(fields)

    def _layout(self, attribute: Element, stored: int) -> tuple[np.dtype[Any], int]:
        """Return type and components of an attribute; InputError if it has not the same number for each element."""
        dtype, size = self._items.layout(attribute)
        if size % stored or not 0 < size // stored <= MAX_COMPONENTS:
            raise damaged(f"{size} values do not divide evenly among {stored} elements")
        return np.dtype(np.float32) if dtype == np.float16 else dtype, size // stored

    def read(self, field: Field, frame: int, objects: Sequence[MeshObject]) -> NDArray[Any]:
        """Return the values (rows, components) of a field in a step; NaN where a part has none."""
        values = np.full((field.row_count(objects), field.components), missing_value(field.dtype), field.dtype)
        key = self._keys[field.name]
        for number, (part, place) in enumerate(zip(self._steps[frame].parts, field.slices(objects), strict=True)):
            rows, one = self._rows[number][field.domain], self._of_part(number, part).get(key)
            if one is None or place.start == place.stop:
                continue
            stored = self._items.only(one).reshape(rows.stored, field.components)[rows.chosen]
            values[place] = stored
            if field.is_exact and not np.array_equal(values[place], stored):
                raise damaged(f"{key[1]!r} has values that are no {field.dtype}, as in other steps; write it again")
        return values
