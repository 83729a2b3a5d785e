"""Arrays inside a zip archive, checked before a byte of them is believed, and read no further than asked for."""

from __future__ import annotations

import math
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError

DEFLATE_FACTOR = 1032
"""Bytes that deflate can make of one: a member that claims more is damaged, or a bomb."""

LOCAL_HEADER_BYTES = 30
"""A zip member's own header, before its name."""


@dataclass(frozen=True)
class ArrayHeader:
    """What an array in NumPy's own format says of itself.

    Parameters
    ----------
    shape : tuple of int
    fortran_order : bool
    dtype : numpy.dtype
    length : int
        Bytes before the numbers.
    """

    shape: tuple[int, ...]
    fortran_order: bool
    dtype: np.dtype[Any]
    length: int

    @property
    def data_bytes(self) -> int:
        return math.prod(self.shape) * self.dtype.itemsize


def read_header(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> ArrayHeader:
    """Read and check the header of a member.

    Raises
    ------
    InputError
        If the array holds Python objects, or does not have the length its header says.
    ValueError
        If it is not an array at all.
    """
    with archive.open(info) as member:
        version = np.lib.format.read_magic(member)
        if version == (1, 0):
            shape, fortran_order, dtype = np.lib.format.read_array_header_1_0(member)
        elif version == (2, 0):
            shape, fortran_order, dtype = np.lib.format.read_array_header_2_0(member)
        else:
            raise InputError(f"{info.filename} has version {version} of NumPy's format; write it as version 1 or 2")
        header = ArrayHeader(shape, fortran_order, dtype, member.tell())
    if dtype.hasobject:
        raise InputError(f"{info.filename} holds Python objects, which are never loaded; store numbers or text")
    if any(size < 0 for size in shape) or header.length + header.data_bytes != info.file_size:
        raise InputError(f"{info.filename} is damaged: its length is not what its header says; write it again")
    if info.file_size > DEFLATE_FACTOR * info.compress_size:
        raise InputError(f"{info.filename} is damaged: it claims more than its bytes can hold; write it again")
    return header


def read_array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    """Read a whole member; never runs what a file holds."""
    read_header(archive, info)
    with archive.open(info) as member:
        array: NDArray[Any] = np.lib.format.read_array(member, allow_pickle=False)
    return array


class StoredArray:
    """An uncompressed member whose first dimension is read piece by piece, straight from the file.

    Its checksum covers the whole member and is not looked at.

    Parameters
    ----------
    path : pathlib.Path
        The archive.
    info : zipfile.ZipInfo
    header : ArrayHeader
        In C order.
    """

    def __init__(self, path: Path, info: zipfile.ZipInfo, header: ArrayHeader) -> None:
        self.shape = header.shape
        self.dtype = header.dtype
        self._path = path
        self._start = _data_offset(path, info) + header.length
        self._row = math.prod(header.shape[1:])

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        start, stop, _ = rows.indices(self.shape[0])
        count = (stop - start) * self._row
        offset = self._start + start * self._row * self.dtype.itemsize
        try:
            with self._path.open("rb") as file:
                file.seek(offset)
                numbers = np.fromfile(file, self.dtype, count)
        except OSError as error:
            raise InputError(f"cannot be read ({error.strerror}); check the file", path=self._path) from error
        if numbers.size < count:
            raise InputError("the file ends early; write it again", path=self._path, frame=start, offset=offset)
        return numbers.reshape(stop - start, *self.shape[1:])


def _data_offset(path: Path, info: zipfile.ZipInfo) -> int:
    """Where a member's bytes start: behind its own header, whose name and extra field may differ in length."""
    with path.open("rb") as file:
        file.seek(info.header_offset)
        local = file.read(LOCAL_HEADER_BYTES)
    name, extra = (int.from_bytes(local[at : at + 2], "little") for at in (26, 28))
    return info.header_offset + LOCAL_HEADER_BYTES + name + extra


def write_header(member: IO[bytes], shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    """Start an array in C order, whose bytes follow."""
    np.lib.format.write_array_header_1_0(
        member, {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    )
