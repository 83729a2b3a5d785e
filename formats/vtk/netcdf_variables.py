"""Read the arrays of a netCDF file by name, and write files like it: netCDF-4, which is HDF5, or classic by SciPy."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pdecodec.codec.source import chosen_limits
from pdecodec.errors import InputError
from pdecodec.formats.arrays.hdf5 import CHUNK_BYTES, check_stored, linked_item, new_hdf5
from pdecodec.formats.vtk.netcdf_file import dimension_name
from pdecodec.mesh.arrays import Int64Array
from pdecodec.system.reading import FileScope, open_regular

CUT = "pdecodec_cut"
"""Attribute of a file whose coded arrays were cut out: arrays that were never written hold nothing of use."""

_OF_LAYOUT = ("CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST")
"""Attributes that HDF5 writes itself when dimensions are given."""

_STEPPED = re.compile(r"time_whole|vals_\w+")
"""Names of Exodus' arrays that have a row for each time step."""


class Variables(Mapping[str, Any]):
    """The arrays of a file by name, read when they are sliced."""

    def __init__(self, path: Path) -> None:
        self.scope = FileScope(path)
        self._opened: dict[str, Any] = {}
        self.classic: Any = None
        with open_regular(path) as file:
            is_classic = file.read(3) == b"CDF"
        if is_classic:
            from scipy.io import netcdf_file

            self.classic = netcdf_file(path, "r", mmap=False)
            self._held: Any = dict(self.classic.variables)
        else:
            self._held = h5py.File(path, "r")

    @property
    def is_cut(self) -> bool:
        """Whether coded arrays were cut out of the file."""
        return self.attribute(CUT) is not None

    def attribute(self, name: str) -> Any:
        """Return an attribute of the file, None if it has none of this name."""
        return (self._held.attrs if self.classic is None else self.classic._attributes).get(name)

    def __getitem__(self, name: str) -> Any:
        if name not in self._opened:
            found = self._held[name] if self.classic is not None else linked_item(self._held, name, self.scope)
            if found is None:
                raise KeyError(name)
            self._opened[name] = found
        return self._opened[name]

    def __contains__(self, name: object) -> bool:
        return name in self._held if self.classic is not None else self._held.get(name, getlink=True) is not None

    def __iter__(self) -> Iterator[str]:
        return iter(self._held)

    def __len__(self) -> int:
        return len(self._held)

    def check_memory(self, names: Iterable[str]) -> None:
        """Raise InputError if the values of arrays take more memory than allowed; arrays never written take none.

        A compressed file, or one in which only a part of each array was written, can be far smaller than its arrays.
        """
        stored = [one for one in map(self.__getitem__, names) if isinstance(one, h5py.Dataset)]
        size = sum(math.prod(one.shape) * one.dtype.itemsize for one in stored if one.id.get_storage_size())
        if size > (most := chosen_limits(None).max_memory):
            raise InputError(f"its arrays take {size} bytes, and {most} are allowed", code="too-large")

    def close(self) -> None:
        self._opened = {}
        (self._held if self.classic is None else self.classic).close()

    @contextmanager
    def file_like(self, path: Path, steps: int | None, *, is_cut: bool = False) -> Iterator[Mapping[str, Any]]:
        """Create a file with the same dimensions, arrays and attributes, and yield its arrays, to be written to.

        `steps` is its number of time steps, by default as many. `is_cut` marks it by :data:`CUT`.

        Raises
        ------
        InputError
            If the file has groups, arrays of no size, or arrays whose values lie in files outside its folder.
        """
        if self.classic is not None:
            yield from self._classic_like(path, steps, is_cut=is_cut)
            return
        with new_hdf5(path, track_order=True) as (file, check):
            yield self._hdf5_like(file, steps, is_cut=is_cut)
            check()

    def _classic_like(self, path: Path, steps: int | None, *, is_cut: bool) -> Iterator[Mapping[str, Any]]:
        from scipy.io import netcdf_file

        old = self.classic
        stepped = {one.dimensions[0] for name, one in self._held.items() if is_stepped(name, one)}
        with netcdf_file(path, "w", version=int(old.version_byte)) as file:
            for name, size in old.dimensions.items():
                # SciPy itself makes an unlimited dimension only before all others.
                file._dims.append(name)
                file.dimensions[name] = size if steps is None or size is None or name not in stepped else steps
            # SciPy stores whatever is set on its objects as attributes of the file.
            file._attributes.update({key: value for key, value in old._attributes.items() if key != CUT})
            file._attributes.update({CUT: 1} if is_cut else {})
            for name, one in self._held.items():
                new = file.createVariable(name, one.data.dtype, one.dimensions)
                # SciPy would leave memory as it is, and let arrays grow row by row.
                shape = list(new.data.shape)
                if one.isrec:
                    shape[0] = one.data.shape[0] if steps is None else steps
                    file.__dict__["_recs"] = max(file._recs, shape[0])
                new.__dict__["data"] = np.zeros(shape, one.data.dtype)
                new._attributes.update(one._attributes)
            yield file.variables

    def _hdf5_like(self, file: Any, steps: int | None, *, is_cut: bool) -> Mapping[str, Any]:
        _copy_attributes(self._held, file)
        if is_cut:
            file.attrs[CUT] = np.int32(1)
        made: dict[str, Any] = {}
        old = {name: self[name] for name in self}
        for name, one in old.items():
            if not isinstance(one, h5py.Dataset) or one.shape is None:
                raise InputError(f"{name} is a group, or an array of no size", code="unsupported-feature")
            if one.is_virtual or one.external is not None:
                check_stored(one, self.scope)
        stepped = {name for name, one in old.items() if is_stepped(name, one)}
        scales = {name: [[scale.name.strip("/") for scale in axis.values()] for axis in old[name].dims] for name in old}
        # That of an unlimited dimension may have no rows.
        stepped |= {scale for name in stepped for scale in scales[name][0] if scale in old and old[scale].shape[0]}
        for name, one in old.items():
            made[name] = _dataset_like(one, file, name, steps if name in stepped else None)
        for name, one in old.items():
            if one.is_scale:
                text = one.attrs.get("NAME", b"")
                made[name].make_scale(dimension_name(made[name].shape[0]) if name in stepped else text)
        for name, one in old.items():
            for axis, there in enumerate(scales[name]):
                for scale in there:
                    made[name].dims[axis].attach_scale(made[scale])
            _copy_attributes(one, made[name])
        return made


def copy_values(old: Any, new: Any, rows: Int64Array | None = None, zeros: Any = None) -> None:
    """Copy the values of an array to another, block by block.

    `rows` are those of the first axis to take, by default all. Of an array (steps, values), `zeros` are columns to set
    to 0.
    """
    is_stored = isinstance(old, h5py.Dataset) and old.external is None and not old.is_virtual
    if is_stored and not old.id.get_storage_size():
        return  # such as the scales of dimensions
    if not old.shape:
        new[()] = old[()]
        return
    wanted = np.arange(old.shape[0]) if rows is None else rows
    at_once = max(1, 8 * CHUNK_BYTES * len(old.shape) // max(1, int(np.prod(old.shape[1:])) * 8))
    for start in range(0, len(wanted), at_once):
        own = wanted[start : start + at_once]
        found: NDArray[Any] = np.asarray(old[int(own.min()) : int(own.max()) + 1])[own - own.min()]
        if zeros is not None:
            found[:, zeros] = 0
        new[start : start + len(own)] = found


def is_stepped(name: str, variable: Any) -> bool:
    return _STEPPED.fullmatch(name) is not None and len(variable.shape) > 0


def _dataset_like(old: Any, file: Any, name: str, steps: int | None) -> Any:
    """Create a dataset of the type and layout of another; never one whose values lie in other files."""
    shape, limits, chunks = list(old.shape), list(old.maxshape), None if old.chunks is None else list(old.chunks)
    if steps is not None:
        shape[0] = steps
        limits[0] = None if limits[0] is None else steps
        if chunks is not None and limits[0] is not None:
            chunks[0] = min(chunks[0], steps)
    layout: dict[str, Any] = {}
    if chunks is not None:
        names = ("compression", "compression_opts", "shuffle", "fletcher32")
        layout = {"chunks": tuple(chunks), "maxshape": tuple(limits), **{key: getattr(old, key) for key in names}}
    if old.dtype.kind in "iuf":
        layout["fillvalue"] = old.fillvalue
    return file.create_dataset(name, tuple(shape), old.dtype, track_times=False, **layout)


def _copy_attributes(old: Any, new: Any) -> None:
    for key, value in old.attrs.items():
        if key not in (*_OF_LAYOUT, CUT):
            new.attrs[key] = value
