"""Fields of clips that have one file per frame: find data that all files of a run share, and read them on request."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import damaged
from pdecodec.mesh.fields import DTYPES, Field, FieldDomain

DataKey = tuple[FieldDomain, str]
"""Domain and name of data."""


def on_elements(name: str, domain: FieldDomain) -> str:
    """Return the field name of data on faces or cells, distinct from that of a vertex field of the same name."""
    return f"{name} ({domain}s)"


@dataclass(frozen=True)
class StoredData:
    """Values on the vertices, faces or cells of one file.

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


def joined_data(
    parts: Sequence[tuple[Mapping[DataKey, StoredData], Mapping[FieldDomain, int]]],
) -> dict[DataKey, StoredData]:
    """Return the data of a mesh made of parts, joined part after part; each part gives its data and numbers of rows.

    Where a part lacks floats, they are NaN; a part without rows lacks nothing. Data whose type differs between
    parts, and whole numbers that a part lacks, are left out.
    """
    found = {}
    for key in dict.fromkeys(key for data, _ in parts for key in data):
        own = [(data.get(key), rows[key[0]]) for data, rows in parts if rows[key[0]] or len(parts) == 1]
        there = [one for one, _ in own if one is not None] or [data[key] for data, _ in parts if key in data][:1]
        is_whole = len(there) == max(len(own), 1)
        if len({one.kind for one in there}) == 1 and (is_whole or there[0].dtype.kind == "f"):
            found[key] = StoredData(*there[0].kind, partial(_joined, own, there[0]))
    return found


def _joined(parts: Sequence[tuple[StoredData | None, int]], one: StoredData) -> NDArray[Any]:
    nothing = np.zeros((0, one.components), one.dtype)
    found = (
        np.full((rows, one.components), np.nan, one.dtype) if part is None else part.read() for part, rows in parts
    )
    return np.concatenate([nothing, *found])


def fields_of_frames(
    frames: Iterable[Mapping[DataKey, tuple[np.dtype[Any], int]]],
) -> tuple[dict[str, tuple[DataKey, Field]], list[str]]:
    """Return the fields of frames by name, given the types and components of their data, and the names of other data.

    Floats may be missing in some frames, and are NaN there. Whole numbers must be in all frames, and the number of
    components must not change.
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
        own = on_elements(name, domain) if name in fields else name
        is_whole = counts[domain, name] == total
        if dtype not in DTYPES or len(widths) > 1 or own in fields or not (is_whole or dtype.kind == "f"):
            lost.append(name)
            continue
        fields[own] = (domain, name), Field(own, domain, dtype, widths.pop())
    return fields, lost
