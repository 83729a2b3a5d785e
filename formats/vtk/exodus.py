"""Read Exodus II from netCDF-4 or netCDF-3: coordinates, blocks of elements, and displacements of every time step.

The netCDF4 package is not needed: netCDF-4 files are HDF5, and SciPy reads netCDF-3. Nodes move by the nodal
variables that Exodus' own programs use as displacements, see :func:`displacements`.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged
from pdecodec.formats.arrays.hdf5 import check_stored, linked_item
from pdecodec.formats.base.attribute_roles import GROUP
from pdecodec.formats.base.times import rate_or_default, timing_of_stored
from pdecodec.formats.vtk.cells import Cells, left_out_notice, node_attribute
from pdecodec.formats.vtk.motion import choose_vectors, contents_of, motion_notices, not_kept_data
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.rounding import to_float32
from pdecodec.mesh.sequence import Attribute, MeshObject, MeshSequence, check_frame_range
from pdecodec.system.reading import FileScope, open_regular

KINDS = {
    "triangle": ("TRI", "TRIANGLE", "TRISHELL"),
    "quad": ("QUAD", "QUADSHELL"),
    "line": ("BAR", "BEAM", "TRUSS", "EDGE", "ROD", "SPHERE", "CIRCLE", "POINT"),
    "tetra": ("TET", "TETRA"),
    "pyramid": ("PYR", "PYRAMID"),
    "wedge": ("WEDGE", "PRISM"),
    "hexahedron": ("HEX", "HEXAHEDRON"),
}
"""Exodus' names of elements, without numbers, by kind of cell."""

_SHELLS = {2: "line", 3: "triangle", 4: "quad", 6: "triangle", 7: "triangle", 8: "quad", 9: "quad"}
"""Kinds of shells by number of nodes."""

AXES = "xyz"

_COMPONENT_NAME = re.compile(r"(?P<base>.+?)_?(?P<axis>[xyz])", re.IGNORECASE | re.DOTALL)
"""Pattern of the name of a nodal variable that is one component of a vector."""

_DISPLACEMENT = "disp"
"""Prefix, in lower case, of names that SEACAS and ParaView use for displacements: displ_x, DISPX, displacement_x."""

_PARTIAL_DISPLACEMENTS = ("disp", "displ", "displacement", "displacements")
"""Names of displacements that count even with fewer components: nodes then do not move along the other axes."""

_VARIABLES = {
    "name_nod_var": "nodal variables",
    "name_elem_var": "element variables",
    "name_edge_var": "edge variables",
    "name_face_var": "face variables",
    "name_nset_var": "node set variables",
    "name_sset_var": "side set variables",
    "name_glo_var": "global variables",
}
"""Names of variables in a notice, by the array that lists them."""

_SETS = (
    ("node sets", "ns_names", r"node_ns(\d+)"),
    ("side sets", "ss_names", r"elem_ss(\d+)"),
    ("element attributes", "", r"attrib(\d+)"),
)
"""Kinds of parts that are not kept: the array that has their names, if any, and arrays that each has one of."""

_KNOWN = re.compile(
    r"coord[xyz]?|coor_names|connect\d+|time_whole|time_step|four|(num|len)_\w+|(eb|ns|ss)_(names|status|prop\d+)"
    r"|(node|dist_fact)_ns\d+|(elem|side|dist_fact)_ss\d+|attrib(_name)?\d+|\w+_var_tab|name_\w+_var|vals_\w+"
    r"|(node|elem)_num_map|elem_map|info_records|qa_records"
)
"""Names of arrays that are read, and of those that describe what :data:`_VARIABLES` and :data:`_SETS` name."""

_RECORDS = ("info_records", "qa_records")
"""Arrays in which programs record what they did."""

NETCDF_FILL = {"f4": float(np.float32(9.969209968386869e36)), "f8": 9.969209968386869e36}
"""netCDF's default fill values, read where a value was never written."""

_DAMAGE = (OSError, LookupError, ValueError, TypeError, ArithmeticError, RuntimeError, AttributeError, MemoryError)
"""Exceptions of h5py, SciPy and NumPy on damaged or missing parts."""


class ExodusSequence(MeshSequence):
    """Shells, surfaces of solids, bars and points of an Exodus II file, moved by their displacements.

    `displacement` names the nodal vector that is added to coordinates; by default the one that Exodus' programs use
    by convention.

    Raises
    ------
    InputError
        If the file is damaged, values were never written, a kind of element is not supported, or no vector has the name
        `displacement`.
    """

    def __init__(self, path: Path, *, fps: float | None, displacement: str | None = None) -> None:
        self._path, self._asked = path, displacement
        self._variables: Any = None
        try:
            self._variables = _Variables(path)
            self._open(fps)
        except _DAMAGE as error:
            self.close()
            raise damaged(f"is no Exodus file, or a damaged one ({error}); export it again", path=path) from error
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
        nodal = self._names("name_nod_var")
        vectors = vectors_of(nodal, len(coordinates))
        chosen = choose_vectors(
            list(vectors), self._asked, self._path, defined=displacements(vectors, len(coordinates))
        )
        offered = [name for name, found in vectors.items() if len(found) >= len(coordinates)]
        self.notices = motion_notices(chosen, offered, self._asked, moves=times.size < 2)
        used: list[str] = []
        self._moving = {}
        for axis, number in ({} if chosen is None else vectors[chosen]).items():
            self._moving[axis] = self._variables[f"vals_nod_var{number}"]
            self._check_variable(self._moving[axis], times.size, nodal[number - 1])
            used.append(nodal[number - 1])
        if times.size and self._moving:
            self.times, self.fps, notices = timing_of_stored(times, fps)
            lacking = [letter for axis, letter in enumerate(AXES[: len(coordinates)]) if axis not in self._moving]
            if lacking:
                self.notices = (*self.notices, f"the displacements have no components along {', '.join(lacking)}")
        else:
            self.times, self.fps, notices = np.zeros(1), rate_or_default(None, fps)[0], ()
            if times.size > 1:
                notices = (
                    f"the shape stands still, one of {times.size} time steps is read: nothing displaces its nodes",
                )
        cells = self._cells()
        connectivity, self._gather = cells.connectivity(self._rest)
        attributes = () if self._gather is None else (node_attribute(self._numbers_of_nodes()[self._gather]),)
        blocks = self._block_names(cells)
        self.objects = (MeshObject("mesh", connectivity, (*attributes, *blocks)),)
        kept = {
            "nodal variables": used,
            "blocks": [label for attribute in blocks for label in attribute.labels],
            "times": ["time_whole"] if times.size else [],
        }
        lost = self._dropped(used, kept["blocks"])
        self.list_contents = lambda: contents_of(self.objects, kept, lost)
        self.notices = (
            *notices,
            *self.notices,
            *not_kept_data(lost),
            *left_out_notice(self._gather, len(self._rest)),
        )
        self.metadata = {}

    def _block_names(self, cells: Cells) -> tuple[Attribute, ...]:
        """Return groups of faces by the names of their blocks; none if no block with faces has a name."""
        names = self._names("eb_names")
        there = np.unique(cells.blocks).tolist()
        labels = {block: names[block - 1] for block in there if block <= len(names) and names[block - 1]}
        if not labels:
            return ()
        rows = np.full(max(there) + 1, -1, np.int32)
        rows[list(labels)] = np.arange(len(labels))
        return (Attribute(GROUP, "face", rows[cells.blocks], labels=tuple(labels.values())),)

    def _dropped(self, used: Sequence[str], labels: Sequence[str]) -> dict[str, list[str]]:
        """Return names of data that are not kept, by kind: variables not in `used`, blocks not in `labels`, and sets.

        Blocks without names lose nothing but their numbers.
        """
        places = dict(_VARIABLES)
        for place in self._variables:
            if re.fullmatch(r"name_.+_var", place):  # later versions have variables of assemblies and blobs
                places.setdefault(place, f"{place[5:-4]} variables")
        kinds = {
            kind: [name for name in self._names(place) if name not in used or place != "name_nod_var"]
            for place, kind in places.items()
        }
        kinds["records"] = [name for name in _RECORDS if name in self._variables]
        kinds["blocks"] = [name for name in self._names("eb_names") if name and name not in labels]
        for kind, names, pattern in _SETS:
            numbers = sorted(int(found[1]) for place in self._variables if (found := re.fullmatch(pattern, place)))
            listed = dict(enumerate(self._names(names), 1))
            kinds[kind] = [
                listed.get(number) or str(number) for number in sorted({*numbers, *(k for k in listed if listed[k])})
            ]
        return kinds | {"other arrays": [name for name in self._variables if not _KNOWN.fullmatch(name)]}

    def _names(self, place: str) -> list[str]:
        """Return the names that an array of the file lists; empty if the array does not exist."""
        return [_text(row) for row in np.asarray(self._variables[place][:])] if place in self._variables else []

    def _numbers(self, name: str) -> Float64Array:
        variable = self._variables[name]
        self._check_variable(variable, None, name)
        values = np.asarray(variable[:], np.float64)
        if (values == _fill_of(variable)).any():
            raise damaged(f"{name} has values that were never written; export it again", path=self._path)
        return values

    def _check_variable(self, variable: Any, steps: int | None, name: str) -> None:
        """Raise InputError if a variable has fewer steps than there are times, or parts of it were never written."""
        if steps is not None and variable.shape[0] < steps:
            raise damaged(
                f"{name} has {variable.shape[0]} steps, and there are {steps} times; export it again", path=self._path
            )
        if isinstance(variable, h5py.Dataset):
            check_stored(variable, self._variables.scope)

    def _numbers_of_nodes(self) -> Int64Array:
        """Return the file's node numbers (nodes,); counted from 1 if it has none."""
        if "node_num_map" in self._variables:
            return np.asarray(self._variables["node_num_map"][:], np.int64)
        return np.arange(1, len(self._rest) + 1)

    def _cells(self) -> Cells:
        cells = Cells()
        # A block without elements has no such variable, but the next one may.
        numbers = sorted(int(key[7:]) for key in self._variables if re.fullmatch(r"connect\d+", key))
        for number in numbers:
            block = self._variables[f"connect{number}"]
            self._check_variable(block, None, f"connect{number}")
            rows = np.asarray(block[:], np.int64) - 1
            name = _text(np.asarray(_kind_of(block)).reshape(-1)).upper().rstrip("0123456789")
            kind = next((kind for kind, names in KINDS.items() if name in names), None)
            if name == "SHELL":
                kind = _SHELLS.get(rows.shape[1])
            if kind is None or rows.ndim != 2:
                raise InputError(
                    f"holds elements of type {name} with {rows.shape[-1]} nodes, which are not read; "
                    "export finite elements",
                    code="unsupported-feature",
                    path=self._path,
                )
            cells.add(kind, rows, number)
        return cells

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = np.repeat(self._rest[None], stop - start, axis=0)
        try:
            for axis, values in self._moving.items():
                moved = np.asarray(values[start:stop], np.float64)
                unwritten = np.flatnonzero((moved == _fill_of(values)).any(axis=1))
                if unwritten.size:
                    message = f"displacements along {AXES[axis]} were never written; export it again"
                    raise InputError(message, code="damaged-input", path=self._path, frame=start + int(unwritten[0]))
                points[:, :, axis] += moved
        except _DAMAGE as error:
            raise InputError(f"cannot be read ({error})", code="unreadable", path=self._path, frame=start) from error
        return to_float32(points if self._gather is None else points[:, self._gather])

    def close(self) -> None:
        self._moving = {}
        if self._variables is not None:
            self._variables.close()


def vectors_of(names: Sequence[str], axes: int) -> dict[str, dict[int, int]]:
    """Return the vectors formed by nodal variables: for each axis the number of its variable, from 1.

    Parameters
    ----------
    names : sequence of str
        Names of the variables, such as ``displ_x``, ``displ_y``, ``displ_z``; case does not matter.
    axes : int
        Number of axes of the coordinates.

    Returns
    -------
    dict
        By names without axes, such as ``displ``: all vectors with a component for every axis, and those named as
        displacements with fewer.
    """
    found: dict[tuple[str, bool], tuple[str, dict[int, int]]] = {}
    for number, name in enumerate(names, 1):
        part = _COMPONENT_NAME.fullmatch(name)
        if part is not None:
            key = part["base"].lower(), "_" in name[part.end("base") :]
            axis = AXES.index(part["axis"].lower())
            found.setdefault(key, (part["base"], {}))[1].setdefault(axis, number)
    vectors = [
        (base, dict(sorted(parts.items())))
        for (lower, _), (base, parts) in found.items()
        if set(range(axes)) <= set(parts) or lower in _PARTIAL_DISPLACEMENTS
    ]
    bases = Counter(base for base, _ in vectors)
    # Two vectors of the same name, ``disp_x`` and ``dispx``, are named by their first variable.
    return {base if bases[base] == 1 else names[min(parts.values()) - 1]: parts for base, parts in vectors}


def displacements(vectors: Mapping[str, Mapping[int, int]], axes: int) -> list[str]:
    """Return the vectors that SEACAS and ParaView use as displacements: names that begin with ``disp``.

    Vectors with a component for every axis take precedence over those with fewer.
    """
    named = [name for name in vectors if name.lower().startswith(_DISPLACEMENT)]
    return [name for name in named if len(vectors[name]) >= axes] or named


def _fill_of(variable: Any) -> float:
    """Return the value that netCDF returns for unwritten values of a variable; NaN if there is none."""
    own = variable.attrs.get("_FillValue") if hasattr(variable, "attrs") else getattr(variable, "_FillValue", None)
    dtype = np.dtype(variable.dtype if hasattr(variable, "dtype") else variable.data.dtype)
    fill = NETCDF_FILL.get(dtype.str[1:], np.nan) if own is None else float(np.asarray(own).reshape(-1)[0])
    return fill or np.nan  # 0 also occurs as a real value


class _Variables(Mapping[str, Any]):
    """The arrays of a file by name, read when they are sliced."""

    def __init__(self, path: Path) -> None:
        self.scope = FileScope(path)
        with open_regular(path) as file:
            classic = file.read(3) == b"CDF"
        if classic:
            from scipy.io import netcdf_file

            self._held: Any = dict(netcdf_file(path, "r", mmap=False).variables)
        else:
            self._held = h5py.File(path, "r")

    def __getitem__(self, name: str) -> Any:
        if isinstance(self._held, dict):
            return self._held[name]
        found = linked_item(self._held, name, self.scope)
        if found is None:
            raise KeyError(name)
        return found

    def __contains__(self, name: object) -> bool:
        return name in self._held if isinstance(self._held, dict) else self._held.get(name, getlink=True) is not None

    def __iter__(self) -> Iterator[str]:
        return iter(self._held)

    def __len__(self) -> int:
        return len(self._held)

    def close(self) -> None:
        if not isinstance(self._held, dict):
            self._held.close()


def _kind_of(block: Any) -> Any:
    """Return the attribute ``elem_type`` of a block."""
    if hasattr(block, "attrs"):
        value = block.attrs["elem_type"]
        return np.frombuffer(value.encode() if isinstance(value, str) else bytes(value), np.uint8)
    return np.frombuffer(bytes(block.elem_type), np.uint8)


def _text(row: NDArray[Any]) -> str:
    """Return characters or their codes as text, up to the first zero."""
    return np.asarray(row).tobytes().partition(b"\0")[0].decode("latin-1").strip()
