"""Fields of clips that have one file per frame: which data all files of a run share, read when they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import damaged
from pdecodec.mesh.fields import DTYPES, Field, FieldDomain

DataKey = tuple[FieldDomain, str]
"""Domain and name of data."""

ON_FACES = "{} (faces)"
"""Name of a field on faces if one on vertices has its name."""


@dataclass(frozen=True)
class StoredData:
    """Values on the vertices or faces of one file.

    Attributes
    ----------
    dtype : dtype
    components : int
    read : callable
        Decodes the values (rows, components).
    """

    dtype: np.dtype[Any]
    components: int
    read: Callable[[], NDArray[Any]]

    @property
    def kind(self) -> tuple[np.dtype[Any], int]:
        return self.dtype, self.components

    @property
    def row_bytes(self) -> int:
        return self.dtype.itemsize * self.components

    def gathered(self, rows: Any) -> StoredData:
        """Return the data of some rows only."""
        return StoredData(self.dtype, self.components, lambda: _taken(self.read(), rows))


def _taken(values: NDArray[Any], rows: Any) -> NDArray[Any]:
    try:
        return values[rows]  # type: ignore[no-any-return]
    except IndexError as error:
        raise damaged(f"data have {len(values)} rows, too few for the mesh; export the file again") from error


def stored_array(values: NDArray[Any]) -> StoredData:
    """Return an array (rows,) or (rows, components) in memory as data."""
    rows = values if values.ndim == 2 else values[:, None]
    return StoredData(rows.dtype.newbyteorder("="), rows.shape[1], lambda: rows)


def joined_data(parts: Sequence[Mapping[DataKey, StoredData]]) -> dict[DataKey, StoredData]:
    """Return the data that all parts of a mesh have with the same type, one part after the other."""
    return {
        key: StoredData(*one.kind, lambda key=key: np.concatenate([part[key].read() for part in parts]))  # type: ignore[misc]
        for key, one in parts[0].items()
        if all(key in part and part[key].kind == one.kind for part in parts)
    }


def fields_of_frames(
    frames: Iterable[Mapping[DataKey, tuple[np.dtype[Any], int]]],
) -> tuple[dict[str, tuple[DataKey, Field]], list[str]]:
    """Return the fields of frames by name, given types and components of their data, and names of other data.

    Floats may be missing in some frames, where they are NaN. Whole numbers must be in all, and components the same.
    """
    kinds: dict[DataKey, set[tuple[np.dtype[Any], int]]] = {}
    counts: dict[DataKey, int] = {}
    total = 0
    for total, frame in enumerate(frames, 1):  # noqa: B007
        for key, kind in frame.items():
            kinds.setdefault(key, set()).add(kind)
            counts[key] = counts.get(key, 0) + 1
    fields: dict[str, tuple[DataKey, Field]] = {}
    lost = []
    for (domain, name), found in sorted(kinds.items(), key=lambda one: one[0][0] != "vertex"):
        dtype = np.result_type(*(kind for kind, _ in found))
        widths = {width for _, width in found}
        own = ON_FACES.format(name) if name in fields else name
        is_whole = counts[domain, name] == total
        if dtype not in DTYPES or len(widths) > 1 or own in fields or not (is_whole or dtype.kind == "f"):
            lost.append(name)
            continue
        fields[own] = (domain, name), Field(own, domain, dtype, widths.pop())
    return fields, lost
