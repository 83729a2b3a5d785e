"""Read Exodus II from netCDF-4 or netCDF-3: coordinates, blocks of elements, and displacements of every time step.

The netCDF4 package is not needed: netCDF-4 files are HDF5, and SciPy reads netCDF-3. Nodes move by the nodal
variables that Exodus' own programs use as displacements, see :func:`displacements`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pdecodec.codec.source import chosen_limits
from pdecodec.errors import InputError, LimitError, damaged
from pdecodec.formats.arrays.hdf5 import HDF5_DAMAGE, check_stored
from pdecodec.formats.base.attribute_roles import GROUP
from pdecodec.formats.base.times import rate_or_default, timing_of_stored
from pdecodec.formats.vtk.cells import BLOCK, Cells, Solids, node_attribute
from pdecodec.formats.vtk.exodus_variables import (
    AXES,
    Part,
    StoredField,
    displacements,
    dtype_of,
    store_fields,
    vectors_of,
)
from pdecodec.formats.vtk.motion import choose_vectors, contents_of, motion_notices, not_kept_data
from pdecodec.formats.vtk.netcdf_variables import Variables
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.fields import DTYPES, Field
from pdecodec.mesh.rounding import to_float32
from pdecodec.mesh.sequence import Attribute, MeshObject, MeshSequence, check_frame_range

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
"""Kinds of parts that are not kept: the array that has their names, if any, and the arrays of which each part
has one.
"""

_KNOWN = re.compile(
    r"coord[xyz]?|coor_names|connect\d+|time_whole|time_step|four|(num|len)_\w+|(eb|ns|ss)_(names|status|prop\d+)"
    r"|(node|dist_fact)_ns\d+|(elem|side|dist_fact)_ss\d+|attrib(_name)?\d+|\w+_var_tab|name_\w+_var|vals_\w+"
    r"|(node|elem)_num_map|elem_map|ebepecnt\d+|info_records|qa_records"
)
"""Names of arrays that are read, and of arrays that describe the items named in :data:`_VARIABLES` and
:data:`_SETS`.
"""

PROGRAM = "pdecodec"
"""Name of the program in the records of files that we write."""

_RECORDS = ("info_records", "qa_records")
"""Arrays in which programs record what they did."""

NETCDF_FILL = {"f4": float(np.float32(9.969209968386869e36)), "f8": 9.969209968386869e36}
"""netCDF's default fill values, read where a value was never written."""


class ExodusSequence(MeshSequence):
    """Shells, surfaces of solids, bars and points of an Exodus II file, moved by their displacements.

    `displacement` names the nodal vector that is added to coordinates; by default the one that Exodus' programs use
    by convention. `solids` says what becomes of solids; cells are kept with the names of their blocks, as the attribute
    ``block``.

    Raises
    ------
    InputError
        If the file is damaged, values were never written, a kind of element is not supported, or no vector has the name
        `displacement`.
    """

    def __init__(
        self, path: Path, *, fps: float | None, displacement: str | None = None, solids: Solids | None = None
    ) -> None:
        self._path, self.asked, self.solids = path, displacement, solids or "surface"
        self.variables: Any = None
        try:
            self.variables = Variables(path)
            self._open(fps)
        except HDF5_DAMAGE as error:
            self.close()
            raise damaged(f"is not an Exodus file, or is damaged ({error}); export it again", path=path) from error
        except InputError:
            self.close()
            raise

    def _open(self, fps: float | None) -> None:
        if "coord" in self.variables:
            coordinates = self._numbers("coord")
        else:
            coordinates = np.stack([self._numbers(f"coord{axis}") for axis in AXES if f"coord{axis}" in self.variables])
        self.axes = len(coordinates)
        self.rest = np.zeros((coordinates.shape[1], 3))
        self.rest[:, : len(coordinates)] = coordinates.T
        times = self._numbers("time_whole") if "time_whole" in self.variables else np.zeros(0)
        nodal = self._names("name_nod_var")
        vectors = vectors_of(nodal, len(coordinates))
        chosen = choose_vectors(list(vectors), self.asked, self._path, defined=displacements(vectors, len(coordinates)))
        if not times.size:
            chosen = None  # without steps, variables have no values
        offered = [name for name, found in vectors.items() if len(found) >= len(coordinates)]
        self.notices = motion_notices(chosen, offered, self.asked, moves=times.size < 2)
        used: list[str] = []
        self._moving, self.moving = dict[int, Any](), dict[int, str]()
        for axis, number in ({} if chosen is None else vectors[chosen]).items():
            self.moving[axis] = f"vals_nod_var{number}"
            self._moving[axis] = self.variables[self.moving[axis]]
            self._check_variable(self._moving[axis], times.size, nodal[number - 1])
            used.append(nodal[number - 1])
        cells, spans = self._cells()
        self.cells, self.spans = cells, spans
        connectivity, self.gather = cells.connectivity(self.rest)
        numbers = self._numbers_of_nodes()
        if self.gather is not None:
            numbers = numbers[self.gather]
        is_plain = self.gather is None and np.array_equal(numbers, np.arange(1, numbers.size + 1))
        attributes = () if is_plain else (node_attribute(numbers),)
        blocks = self._block_names(spans, cells.owners)
        if cells.has_cells:
            blocks = (*blocks, self._blocks_of_cells(spans))
        self.objects = (MeshObject("mesh", connectivity, (*attributes, *blocks)),)
        kept = self._find_fields(times, len(coordinates), used, spans, None if cells.has_cells else cells.owners)
        self.has_steps = bool(times.size and (self._moving or self.stored))
        if self.has_steps:
            self.times, self.fps, notices = timing_of_stored(times, fps)
            lacking = [letter for axis, letter in enumerate(AXES[: len(coordinates)]) if axis not in self._moving]
            if self._moving and lacking:
                self.notices = (*self.notices, f"the displacements have no components along {', '.join(lacking)}")
        else:
            self.times, self.fps, notices = np.zeros(1), rate_or_default(None, fps)[0], ()
            if times.size > 1:
                notices = (f"only 1 of {times.size} time steps is read, because nothing displaces the nodes",)
        kept |= {
            "blocks": [label for attribute in blocks for label in attribute.labels],
            "times": ["time_whole"] if times.size else [],
        }
        self.lost = lost = self._dropped(kept)
        self.list_contents = lambda: contents_of(self.objects, kept, lost)
        self.notices = (
            *notices,
            *self.notices,
            *not_kept_data(lost),
            *cells.left_out_notices(self.gather, len(self.rest)),
            *(cells.inner_notice("elements", "element variables") if kept["element variables"] else ()),
        )
        self.metadata = {}

    def _find_fields(
        self, times: Float64Array, axes: int, used: Sequence[str], spans: Mapping[int, slice], owners: Int64Array | None
    ) -> dict[str, list[str]]:
        """Keep the variables on nodes and faces as fields, and return the names of all kept variables, by kind.

        An element variable becomes a field of the faces of its elements (numbered by `owners`), or of the elements
        if these are kept as cells; elements of blocks without the variable get NaN. Variables in `used` move the
        mesh, and do not become fields.
        """
        self.stored: dict[str, StoredField] = {}
        kept = {"nodal variables": list(used), "element variables": list[str]()}
        if not self._moving and not _are_steps(times):
            return kept
        whole = slice(None)
        nodes = Part(whole if self.gather is None else self.gather, whole, "vals_nod_var{}", len(self.rest))
        faces = []
        cells = np.arange(max((span.stop for span in spans.values()), default=0)) if owners is None else owners
        for number, span in spans.items():
            own = np.flatnonzero((cells >= span.start) & (cells < span.stop))
            if own.size:
                size = span.stop - span.start
                faces.append(Part(cells[own] - span.start, own, f"vals_elem_var{{}}eb{number}", size))

        def find(name: str, part: Part) -> Any:
            return self.variables[name] if self._has_values(name, times.size, part) else None

        others = ["" if name in used else name for name in self._names("name_nod_var")]
        kept["nodal variables"] += store_fields(self.stored, "vertex", others, axes, [nodes], find)
        kept["element variables"] += store_fields(
            self.stored, "cell" if owners is None else "face", self._names("name_elem_var"), axes, faces, find
        )
        self.fields = tuple(one.field for one in self.stored.values())
        return kept

    def _has_values(self, name: str, steps: int, part: Part) -> bool:
        """Return whether a variable has a value for every step and element of a part, all of them in the file."""
        if name not in self.variables:
            return False
        try:
            variable = self.variables[name]
            self._check_variable(variable, steps, name)
        except InputError:
            return False
        return bool(
            len(variable.shape) == 2
            and variable.shape[1] == part.values
            and dtype_of(variable).newbyteorder("=") in DTYPES
        )

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        try:
            return self.stored[field.name].read(start, stop, field.row_count(self.objects), fill_of)
        except HDF5_DAMAGE as error:
            raise InputError(f"cannot be read ({error})", code="unreadable", path=self._path, frame=start) from error

    def _block_names(self, spans: Mapping[int, slice], owners: Int64Array) -> tuple[Attribute, ...]:
        """Return groups of faces by the names of their blocks; none if no block with faces has a name."""
        names, numbers = self._names("eb_names"), np.array(list(spans), np.int64)
        starts = [span.start for span in spans.values()]
        block_of_face = numbers[np.searchsorted(starts, owners, side="right") - 1] if owners.size else owners
        there = np.unique(block_of_face).tolist()
        labels = {block: names[block - 1] for block in there if block <= len(names) and names[block - 1]}
        if not labels:
            return ()
        rows = np.full(max(there) + 1, -1, np.int32)
        rows[list(labels)] = np.arange(len(labels))
        return (Attribute(GROUP, "face", rows[block_of_face], labels=tuple(labels.values())),)

    def _blocks_of_cells(self, spans: Mapping[int, slice]) -> Attribute:
        """Return the block of each cell; blocks without names are called by their numbers."""
        names = self._names("eb_names")
        ids = np.asarray(self.variables["eb_prop1"][:]).tolist() if "eb_prop1" in self.variables else []
        labels = [
            (names[block - 1] if block <= len(names) else "") or str(ids[block - 1] if block <= len(ids) else block)
            for block in spans
        ]
        sizes = [span.stop - span.start for span in spans.values()]
        return Attribute(BLOCK, "cell", np.repeat(np.arange(len(sizes), dtype=np.int32), sizes), labels=tuple(labels))

    def _dropped(self, kept: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
        """Return names of data that are not in `kept`, by kind: variables, blocks and sets.

        Blocks without names lose nothing but their numbers.
        """
        places = dict(_VARIABLES)
        for place in self.variables:
            if re.fullmatch(r"name_.+_var", place):  # later versions have variables of assemblies and blobs
                places.setdefault(place, f"{place[5:-4]} variables")
        kinds = {
            kind: [name for name in self._names(place) if name not in kept.get(kind, ())]
            for place, kind in places.items()
        }
        kinds["records"] = [name for name in _RECORDS if name in self.variables and not self.is_ours()]
        kinds["blocks"] = [name for name in self._names("eb_names") if name and name not in kept["blocks"]]
        for kind, names, pattern in _SETS:
            numbers = sorted(int(found[1]) for place in self.variables if (found := re.fullmatch(pattern, place)))
            listed = dict(enumerate(self._names(names), 1))
            kinds[kind] = [
                listed.get(number) or str(number) for number in sorted({*numbers, *(k for k in listed if listed[k])})
            ]
        return kinds | {"other arrays": [name for name in self.variables if not _KNOWN.fullmatch(name)]}

    def is_ours(self) -> bool:
        """Return whether the only record is that of our writer, which need not be kept."""
        records = np.asarray(self.variables["qa_records"][:]) if "qa_records" in self.variables else np.zeros(0)
        return records.ndim == 3 and len(records) == 1 and _text(records[0, 0]) == PROGRAM

    def _names(self, place: str) -> list[str]:
        """Return the names that an array of the file lists; empty if the array does not exist."""
        return [_text(row) for row in np.asarray(self.variables[place][:])] if place in self.variables else []

    def _numbers(self, name: str) -> Float64Array:
        variable = self.variables[name]
        self._check_variable(variable, None, name)
        values = np.asarray(variable[:], np.float64)
        if (values == fill_of(variable)).any():
            raise damaged(f"{name} has values that were never written; export it again", path=self._path)
        return values

    def _check_variable(self, variable: Any, steps: int | None, name: str) -> None:
        """Raise InputError if a variable has fewer steps than there are times, or parts of it were never written."""
        if steps is not None and variable.shape[0] < steps:
            raise damaged(
                f"{name} has {variable.shape[0]} steps, and there are {steps} times; export it again", path=self._path
            )
        most = chosen_limits(None).max_memory
        if self.variables.is_cut and steps is None and int(np.prod(variable.shape, dtype=object)) * 8 > most:
            # What was never written takes no room in the file.
            raise LimitError(f"{name} takes more than {most} bytes", code="memory-limit", limit="max_memory")
        if isinstance(variable, h5py.Dataset) and not self.variables.is_cut:
            check_stored(variable, self.variables.scope)

    def _numbers_of_nodes(self) -> Int64Array:
        """Return the file's node numbers (nodes,); counted from 1 if it has none."""
        if "node_num_map" in self.variables:
            return np.asarray(self.variables["node_num_map"][:], np.int64)
        return np.arange(1, len(self.rest) + 1)

    def _cells(self) -> tuple[Cells, dict[int, slice]]:
        """Return the elements, and the range of elements of each block."""
        cells, spans = Cells(solids=self.solids), dict[int, slice]()
        # A block without elements has no such variable, but later blocks may have one.
        numbers = sorted(int(key[7:]) for key in self.variables if re.fullmatch(r"connect\d+", key))
        for number in numbers:
            block = self.variables[f"connect{number}"]
            self._check_variable(block, None, f"connect{number}")
            rows = np.asarray(block[:], np.int64) - 1
            name = _text(np.asarray(_kind_of(block)).reshape(-1)).upper().rstrip("0123456789")
            kind = next((kind for kind, names in KINDS.items() if name in names), None)
            if name == "NSIDED" and rows.ndim == 1:
                first = cells.count
                cells.add_polygons(np.asarray(self.variables[f"ebepecnt{number}"][:], np.int64), rows)
                spans[number] = slice(first, cells.count)
                continue
            if name == "SHELL":
                kind = _SHELLS.get(rows.shape[1])
            if kind is None or rows.ndim != 2:
                raise InputError(
                    f"holds elements of type {name} with {rows.shape[-1]} nodes, which are not read; "
                    "export finite elements",
                    code="unsupported-feature",
                    path=self._path,
                )
            spans[number] = slice(cells.count, cells.count + len(rows))
            cells.add(kind, rows)
        return cells, spans

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = np.repeat(self.rest[None], stop - start, axis=0)
        try:
            for axis, values in self._moving.items():
                moved = np.asarray(values[start:stop], np.float64)
                unwritten = np.flatnonzero((moved == fill_of(values)).any(axis=1))
                if unwritten.size:
                    message = f"displacements along {AXES[axis]} were never written; export it again"
                    raise InputError(message, code="damaged-input", path=self._path, frame=start + int(unwritten[0]))
                points[:, :, axis] += moved
        except HDF5_DAMAGE as error:
            raise InputError(f"cannot be read ({error})", code="unreadable", path=self._path, frame=start) from error
        return to_float32(points if self.gather is None else points[:, self.gather])

    def close(self) -> None:
        self._moving, self.stored = {}, {}
        if self.variables is not None:
            self.variables.close()


def fill_of(variable: Any) -> float:
    """Return the value that netCDF returns for unwritten values of a variable; NaN if there is none."""
    own = variable.attrs.get("_FillValue") if hasattr(variable, "attrs") else getattr(variable, "_FillValue", None)
    fill = NETCDF_FILL.get(dtype_of(variable).str[1:], np.nan) if own is None else float(np.asarray(own).reshape(-1)[0])
    return fill or np.nan  # 0 also occurs as a real value


def _are_steps(times: Float64Array) -> bool:
    """Return whether times are finite and increase."""
    return bool(times.size and np.isfinite(times).all() and (np.diff(times) > 0).all())


def _kind_of(block: Any) -> Any:
    """Return the attribute ``elem_type`` of a block."""
    if hasattr(block, "attrs"):
        value = block.attrs["elem_type"]
        return np.frombuffer(value.encode() if isinstance(value, str) else bytes(value), np.uint8)
    return np.frombuffer(bytes(block.elem_type), np.uint8)


def _text(row: NDArray[Any]) -> str:
    """Return characters or their codes as text, up to the first zero."""
    raw = np.asarray(row).tobytes().partition(b"\0")[0]
    try:
        return raw.decode().strip()
    except UnicodeDecodeError:
        return raw.decode("latin-1").strip()
