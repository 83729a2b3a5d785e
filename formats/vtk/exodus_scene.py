"""Cut the motion, coded variables and cells out of an Exodus file, and fill the cells again.

In netCDF-4 files, what is cut is an array that was never written; in classic ones, zeros.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import damaged
from pdecodec.formats.base.carried_fields import StoredFields
from pdecodec.formats.base.carrying import Stripped
from pdecodec.formats.base.onto import Fitted
from pdecodec.formats.vtk.cells import EXODUS_PLACES, FLAT_PLACES
from pdecodec.formats.vtk.exodus import ExodusSequence
from pdecodec.formats.vtk.exodus_variables import AXES
from pdecodec.formats.vtk.netcdf_variables import Variables, copy_values
from pdecodec.mesh.sequence import CELL_SHAPES, Connectivity, MeshSequence

ROOT = "scene.exo"
"""Name of the file in a carrier."""

_BLOCK = re.compile(r"connect[1-9]\d*")
"""Names of the arrays of elements."""


class ExodusFamily:
    """Cutting and filling of Exodus files."""

    def strip(
        self,
        original: ExodusSequence,
        source: Path,
        fits: Sequence[Fitted],
        *,
        exact_uvs: bool,
        fields: StoredFields,
    ) -> Stripped:
        """Return the file without coded arrays."""
        gone = _replaced(original, fields.names)
        blocks = []
        for number, span in original.spans.items():
            name, stored = f"connect{number}", np.asarray(original.variables[f"connect{number}"][:])
            known = _elements(fits[0].item.connectivity, span, stored.ndim == 1)
            if original.gather is None and known is not None and np.array_equal(stored, known):
                blocks.append([name, span.start, span.stop])
                gone[name] = None
        with tempfile.TemporaryDirectory(prefix="pdecodec-") as room:
            place = Path(room, ROOT)
            with original.variables.file_like(place, None, is_cut=True) as new:
                original.variables.check_memory(name for name in original.variables if gone.get(name, ...) is not None)
                for name in original.variables:
                    if name not in gone:
                        copy_values(original.variables[name], new[name])
                    elif gone[name] is not None:
                        copy_values(original.variables[name], new[name], zeros=gone[name])
            data = place.read_bytes()
        reading = {"solids": original.solids, "displacement": original.asked}
        cuts = {"blocks": blocks, **{key: value for key, value in reading.items() if value is not None}}
        return Stripped({ROOT: data}, ROOT, cuts, _contents(original), fields=tuple(fields.names))

    def fill(self, folder: Path, cuts: dict[str, Any], sequence: MeshSequence, suffix: str) -> None:
        """Write the cells into the file in a folder."""
        place = folder / ROOT
        variables = Variables(place)
        is_classic, widths = variables.classic is not None, {name: len(variables[name].shape) for name in variables}
        variables.close()
        arrays = []
        for name, first, stop in cuts["blocks"]:
            if not _BLOCK.fullmatch(name):
                raise ValueError(f"{name} is no block of elements")
            arrays.append((name, _elements(sequence.objects[0].connectivity, slice(first, stop), widths[name] == 1)))
        if is_classic:
            from scipy.io import netcdf_file

            with netcdf_file(place, "a", mmap=False) as file:
                for name, rows in arrays:
                    _fill(file.variables[name], rows)
            return
        with h5py.File(place, "r+") as file:
            for name, rows in arrays:
                # Nothing may be written to another file.
                if not isinstance(file.get(name, getlink=True), h5py.HardLink) or file[name].external is not None:
                    raise ValueError(f"{name} is not in the file")
                if file[name].is_virtual:
                    raise ValueError(f"{name} is made of other arrays")
                _fill(file[name], rows)


def _fill(array: Any, rows: NDArray[np.integer] | None) -> None:
    if rows is None or tuple(array.shape) != rows.shape:
        raise damaged("the scene does not fit the meshes of the file")
    array[:] = rows


def _replaced(original: ExodusSequence, fields: Collection[str]) -> dict[str, Any]:
    """Return the arrays that the motion and coded fields replace, with those of their columns; None for all."""
    variables, gather = original.variables, original.gather
    found: dict[str, Any] = dict.fromkeys(original.moving.values(), gather)
    # Nodes that stand at their coordinates in the first step have the same in its place.
    stands = all(not np.asarray(variables[name][:1]).any() for name in original.moving.values())
    if stands and gather is None and not original.cells.is_reversed:
        found |= {name: None for name in ("coord", *(f"coord{axis}" for axis in AXES)) if name in variables}
    names = {id(variables[name]): name for name in variables}
    for name in fields:
        for part, arrays in original.stored[name].parts:
            whole = isinstance(part.columns, slice) or np.unique(part.columns).size == part.values
            found |= {names[id(array)]: None if whole else part.columns for array in arrays}
    return found


def _elements(whole: Connectivity, span: slice, flat: bool) -> NDArray[np.integer] | None:
    """Return the nodes of a block's elements, from 1, as the decoder knows them; None if it does not."""
    cells = whole.cell_count > 0
    counts, indices = (whole.cell_counts, whole.cell_indices) if cells else (whole.face_counts, whole.face_indices)
    own = counts[span]
    if own.size != span.stop - span.start or (not cells and whole.line_counts.size):
        return None
    first = int(counts[: span.start].sum(dtype=np.int64))
    nodes = indices[first : first + int(own.sum(dtype=np.int64))] + 1
    if flat:
        return nodes
    if not own.size or (own != own[0]).any():
        return None
    rows = nodes.reshape(own.size, -1)
    if not cells:
        order = FLAT_PLACES.get(rows.shape[1])
        return None if order is None else rows[:, order]
    places = EXODUS_PLACES.get((CELL_SHAPES[whole.cell_shapes[span.start]], rows.shape[1]))
    return rows if places is None else rows[:, np.argsort(places)]


def _contents(original: ExodusSequence) -> dict[str, int]:
    """Return what the coded mesh does not hold."""
    title = original.variables.attribute("title")
    ids = original.variables["eb_prop1"][:] if "eb_prop1" in original.variables else np.zeros(0)
    numbers = {} if original.is_ours() else {
        "title": int(bool(title)), "block number": int((ids != np.arange(1, ids.size + 1)).sum())
    }  # fmt: skip
    return {**{kind[:-1]: len(names) for kind, names in original.lost.items()}, **numbers}
