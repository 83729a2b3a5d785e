"""Write netCDF-4 with h5py: datasets of HDF5 whose dimensions are scales, as the netCDF library expects.

netCDF-4 is used, and not the classic format that SciPy writes: datasets of HDF5 are written and read block by block,
but SciPy holds a whole file in memory. Classic files also limit the size of a variable, and lack integers of 64 bits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.arrays.hdf5 import CHUNK_BYTES, new_hdf5

_WITHOUT_VARIABLE = "This is a netCDF dimension without variable{:10d}"
"""Name by which netCDF knows that a scale is only a dimension."""


def dimension_name(size: int) -> str:
    """Return the name of the scale of a dimension that has no variable."""
    return _WITHOUT_VARIABLE.format(size)


class NetcdfWriter:
    """A netCDF-4 file that is being written.

    Attributes
    ----------
    check : callable
        Raises the OSError of a failed write.
    """

    def __init__(self, file: Any, check: Callable[[], None]) -> None:
        self._file, self.check = file, check
        self._sizes: dict[str, int] = {}
        self._unlimited: set[str] = set()

    def set_attributes(self, values: Mapping[str, np.generic]) -> None:
        """Set attributes of the file."""
        self._file.attrs.update(values)

    def add_dimension(self, name: str, size: int, *, unlimited: bool = False) -> None:
        """Add a dimension of at least 1; others can be appended to an unlimited one later."""
        scale = self._file.create_dataset(
            name,
            (size,),
            "<f4",
            maxshape=(None if unlimited else size,),
            chunks=(1024,) if unlimited else None,
            track_times=False,
        )
        scale.make_scale(dimension_name(size))
        scale.attrs["_Netcdf4Dimid"] = np.int32(len(self._sizes))
        self._sizes[name] = size
        if unlimited:
            self._unlimited.add(name)

    def size(self, dimension: str) -> int:
        return self._sizes[dimension]

    def add_variable(
        self,
        name: str,
        dimensions: Sequence[str],
        dtype: Any,
        values: NDArray[Any] | None = None,
        attributes: Mapping[str, np.generic] = {},
    ) -> Any:
        """Return a new variable, to which values (of the shape of its dimensions) can be written by slices."""
        shape = tuple(self._sizes[one] for one in dimensions)
        whole = [None if one in self._unlimited else size for one, size in zip(dimensions, shape, strict=True)]
        kind, chunks = np.dtype(dtype), None
        if None in whole:
            row = max(1, int(np.prod(shape[1:])) * kind.itemsize)
            chunks = (min(shape[0], max(1, CHUNK_BYTES // row)), *shape[1:])
        variable = self._file.create_dataset(
            name, shape, kind.newbyteorder("<"), maxshape=tuple(whole), chunks=chunks, track_times=False
        )
        for axis, one in enumerate(dimensions):
            variable.dims[axis].attach_scale(self._file[one])
        variable.attrs.update(attributes)
        if values is not None:
            variable[...] = values
        self.check()
        return variable


@contextmanager
def new_netcdf(path: Path) -> Iterator[NetcdfWriter]:
    """Create a netCDF-4 file; the OSError of a failed write is raised by :meth:`NetcdfWriter.check`, or at the end."""
    with new_hdf5(path, track_order=True) as (file, check):
        yield NetcdfWriter(file, check)
