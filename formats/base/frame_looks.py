"""UVs and colours of clips that have one file per frame: attributes if they are constant, fields if they change."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pdecodec.formats.base.attribute_roles import COLOR, UV, is_by_vertex, is_role, rows_or_nan
from pdecodec.formats.base.frame_data import DataKey, StoredData, stored_array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import Attribute, Connectivity


def is_same_attribute(mine: Attribute | None, other: Attribute | None) -> bool:
    """Return whether two attributes of the same name and domain hold the same values, or both are missing."""
    if mine is None or other is None:
        return mine is other
    if mine.labels != other.labels or (mine.indices is None) != (other.indices is None):
        return False
    if mine.indices is not None and other.indices is not None and not np.array_equal(mine.indices, other.indices):
        return False
    return np.array_equal(mine.values, other.values, equal_nan=mine.values.dtype.kind == "f")


def looks_of_frame(attributes: Sequence[Attribute], connectivity: Connectivity) -> dict[DataKey, StoredData]:
    """Return the UVs and colours among attributes as data; NaN if an element has none."""
    found: dict[DataKey, StoredData] = {}
    for one in attributes:
        if is_role(one, UV) or is_role(one, COLOR):
            by_vertex = is_role(one, UV) and one.domain == "corner" and is_by_vertex(one, connectivity)
            values = one.values if by_vertex or one.indices is None else rows_or_nan(one)
            found["vertex" if by_vertex else one.domain, one.name] = stored_array(values)
    return found


class ChangingLooks:
    """UVs and colours of the frames of a run, which become fields if they change and every frame has them.

    Parameters
    ----------
    first : sequence of Attribute
        Attributes of the first frame.
    connectivity : Connectivity
    """

    def __init__(self, first: Sequence[Attribute], connectivity: Connectivity) -> None:
        self._first, self._connectivity = {one.name: one for one in first}, connectivity
        self._kinds = {key: one.kind for key, one in looks_of_frame(first, connectivity).items()}
        self._keys = {key[1]: key for key in self._kinds}
        self._changed, self._uneven = set[str](), set[str]()

    def compare(self, attributes: Sequence[Attribute]) -> set[str]:
        """Compare the attributes of a frame with the first frame's; return the names of those that are stored
        alike in both.
        """
        kinds = {key: one.kind for key, one in looks_of_frame(attributes, self._connectivity).items()}
        others = {one.name: one for one in attributes}
        same = {name for name, key in self._keys.items() if kinds.get(key) == self._kinds[key]}
        self._uneven |= self._keys.keys() - same
        for name in same - self._changed:
            self._changed |= set() if is_same_attribute(self._first[name], others[name]) else {name}
        return same

    def fields(self) -> dict[str, tuple[DataKey, Field]]:
        """Return the fields of UVs and colours that change, by name, each with the key of its data."""
        found = {}
        for name in sorted(self._changed - self._uneven):
            key = self._keys[name]
            found[name] = key, Field(name, key[0], *self._kinds[key])
        return found
