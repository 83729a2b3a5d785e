"""Exodus II: coordinates, blocks of elements, and displacements of every time step, from netCDF-4 or netCDF-3 files.

Read without the netCDF4 package: netCDF-4 files are HDF5, netCDF-3 files SciPy reads.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.formats.base.times import rate_or_default, timing_of_stored
from pdecodec.formats.vtk.cells import Cells, left_out_notice, node_attribute
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.rounding import to_float32
from pdecodec.mesh.sequence import MeshObject, MeshSequence, check_frame_range

KINDS = {
    "triangle": ("TRI", "TRIANGLE", "TRISHELL"),
    "quad": ("QUAD", "QUADSHELL"),
    "line": ("BAR", "BEAM", "TRUSS", "EDGE", "ROD", "SPHERE", "CIRCLE", "POINT"),
    "tetra": ("TET", "TETRA"),
    "pyramid": ("PYR", "PYRAMID"),
    "wedge": ("WEDGE", "PRISM"),
    "hexahedron": ("HEX", "HEXAHEDRON"),
}
"""Kinds of cells, and Exodus' names of elements without their numbers."""

_SHELLS = {2: "line", 3: "triangle", 4: "quad", 6: "triangle", 7: "triangle", 8: "quad", 9: "quad"}
"""What shells are, by their number of nodes."""

AXES, DISPLACEMENTS = "XYZ", ("DISPL", "DISP", "DISP_", "DISPLACEMENT_", "U")
"""Axes and beginnings of the names of displacements."""

_DAMAGE = (OSError, KeyError, ValueError, TypeError, IndexError, RuntimeError, AttributeError)
"""What h5py, SciPy and NumPy raise on damaged or missing parts."""


class ExodusSequence(MeshSequence):
    """Shells, surfaces of solids, bars and points of an Exodus II file, moved by their displacements.

    Raises
    ------
    InputError
        If it is damaged, or has elements of kinds that are not read.
    """

    def __init__(self, path: Path, *, fps: float | None) -> None:
        self._path = path
        try:
            self._variables = _open_variables(path)
            self._open(fps)
        except _DAMAGE as error:
            self.close()
            raise InputError(f"is no Exodus file, or a damaged one ({error}); export it again", path=path) from error
        except InputError:
            self.close()
            raise

    def _open(self, fps: float | None) -> None:
        if "coord" in self._variables:
            coordinates = self._numbers("coord")
        else:
            coordinates = np.stack(
                [self._numbers(f"coord{axis}") for axis in "xyz" if f"coord{axis}" in self._variables]
            )
        self._rest = np.zeros((coordinates.shape[1], 3))
        self._rest[:, : len(coordinates)] = coordinates.T
        times = self._numbers("time_whole") if "time_whole" in self._variables else np.zeros(0)
        self._moving = self._displacements()
        if times.size and self._moving:
            self.times, self.fps, self.notices = timing_of_stored(times, fps)
        else:
            self.times, self.fps, self.notices = np.zeros(1), rate_or_default(None, fps)[0], ()
            if times.size > 1:
                self.notices = ("no displacements (DISPLX, ...) are in it: its shape stays",)
        connectivity, self._gather = self._cells().connectivity(self._rest)
        attributes = () if self._gather is None else (node_attribute(self._numbers_of_nodes()[self._gather]),)
        self.objects = (MeshObject("mesh", connectivity, attributes),)
        self.notices = (*self.notices, *left_out_notice(self._gather, len(self._rest)))
        self.metadata = {}

    def _numbers(self, name: str) -> Float64Array:
        return np.asarray(self._variables[name][:], np.float64)

    def _displacements(self) -> dict[int, Any]:
        """The variable of each axis."""
        if "name_nod_var" not in self._variables:
            return {}
        names = [_text(row).upper() for row in np.asarray(self._variables["name_nod_var"][:])]
        found = {}
        for number, name in enumerate(names, 1):
            for axis, letter in enumerate(AXES):
                if name in {f"{start}{letter}" for start in DISPLACEMENTS}:
                    found[axis] = self._variables[f"vals_nod_var{number}"]
        return found

    def _numbers_of_nodes(self) -> Int64Array:
        """(nodes,): what the file calls its nodes; from 1 where it does not say."""
        if "node_num_map" in self._variables:
            return np.asarray(self._variables["node_num_map"][:], np.int64)
        return np.arange(1, len(self._rest) + 1)

    def _cells(self) -> Cells:
        cells = Cells()
        number = 1
        while f"connect{number}" in self._variables:
            block = self._variables[f"connect{number}"]
            rows = np.asarray(block[:], np.int64) - 1
            name = _text(np.asarray(_kind_of(block)).reshape(-1)).upper().rstrip("0123456789")
            kind = next((kind for kind, names in KINDS.items() if name in names), None)
            if name == "SHELL":
                kind = _SHELLS.get(rows.shape[1])
            if kind is None or rows.ndim != 2:
                raise InputError(
                    f"holds elements of type {name} with {rows.shape[-1]} nodes, which are not read; "
                    "export finite elements",
                    path=self._path,
                )
            cells.add(kind, rows)
            number += 1
        return cells

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = np.repeat(self._rest[None], stop - start, axis=0)
        try:
            for axis, values in self._moving.items():
                points[:, :, axis] += np.asarray(values[start:stop], np.float64)
        except _DAMAGE as error:
            raise InputError(f"cannot be read ({error})", path=self._path, frame=start) from error
        return to_float32(points if self._gather is None else points[:, self._gather])

    def close(self) -> None:
        self._moving = {}
        close = getattr(getattr(self, "_variables", None), "close", None)
        if close is not None:
            close()
        self._variables = {}


def _open_variables(path: Path) -> Any:
    """A mapping of names to arrays that are read when they are sliced."""
    with path.open("rb") as file:
        classic = file.read(3) == b"CDF"
    if not classic:
        return h5py.File(path, "r")
    from scipy.io import netcdf_file

    return dict(netcdf_file(path, "r", mmap=False).variables)


def _kind_of(block: Any) -> Any:
    """The attribute ``elem_type`` of a block."""
    if hasattr(block, "attrs"):
        value = block.attrs["elem_type"]
        return np.frombuffer(value.encode() if isinstance(value, str) else bytes(value), np.uint8)
    return np.frombuffer(bytes(block.elem_type), np.uint8)


def _text(row: NDArray[Any]) -> str:
    """Characters or their codes as text, up to the first zero."""
    return np.asarray(row).tobytes().partition(b"\0")[0].decode("latin-1").strip()
