"""Small Exodus files of netCDF-4, written by h5py."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64)


def names_of(names: Sequence[str]) -> np.ndarray:
    """Return names as Exodus stores them: rows of 33 characters."""
    return np.array([list(name.ljust(33, "\0")) for name in names], "S1")


def write_exodus(
    path: Path,
    nodal: Mapping[str, np.ndarray],
    *,
    points: np.ndarray = SQUARE,
    times: Sequence[float] = (0.0, 0.1, 0.2),
    blocks: Mapping[int, Sequence[Sequence[int]]] = {1: [[1, 2, 3, 4]]},
    kind: str = "SHELL4",
    listed: Mapping[str, Sequence[str]] = {},
    elements: Mapping[str, Mapping[int, np.ndarray]] = {},
) -> None:
    """Write nodes, blocks of elements by number, and nodal variables, either (steps, nodes) or one number per step.

    `listed` maps variables to further lists of names; `elements` maps blocks to variables (steps, elements).
    """
    with h5py.File(path, "w") as file:
        for number in range(points.shape[1]):
            file[f"coord{'xyz'[number]}"] = points[:, number]
        file["time_whole"] = np.array(times)
        for number, cells in blocks.items():
            file[f"connect{number}"] = np.array(cells, np.int32)
            file[f"connect{number}"].attrs["elem_type"] = np.bytes_(kind.encode())
        own = {"name_nod_var": list(nodal), "name_elem_var": list(elements)}
        for place, names in {**listed, **{place: names for place, names in own.items() if names}}.items():
            file[place] = names_of(names)
        for number, values in enumerate(nodal.values(), 1):
            shape = (len(times), len(points))
            file[f"vals_nod_var{number}"] = np.broadcast_to(
                np.asarray(values, np.float64).reshape(len(times), -1), shape
            )
        for number, of_blocks in enumerate(elements.values(), 1):
            for block, found in of_blocks.items():
                file[f"vals_elem_var{number}eb{block}"] = found.astype(np.float64)
