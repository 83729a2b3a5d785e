"""Read and write NPZ: a NumPy archive of ``points`` and, if known, faces, times and everything else.

The arrays are those of :mod:`pdecodec.formats.base.object_arrays`. Points stored without compression, as our writer
and ``numpy.savez`` store them, are read in blocks; compressed ones are loaded whole. Headers are validated before
any array is read.
"""

from __future__ import annotations

import math
import sys
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged
from pdecodec.formats.base.object_arrays import LaidOutSequence, arrays_of, check_has_points, fields_as_arrays
from pdecodec.formats.base.registry import Output, read_errors
from pdecodec.mesh.sequence import MeshSequence
from pdecodec.system.storage import RemoteFile

EARLIEST_DATE = (1980, 1, 1, 0, 0, 0)
"""Earliest date of the zip format, written for every member: same input, same bytes."""

DEFLATE_FACTOR = 1032
"""Largest ratio of deflate compression: a member that claims more is damaged or a bomb."""

LOCAL_HEADER_BYTES = 30
"""Size of a zip member's local header before its name [bytes]."""

_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    ArithmeticError,
    EOFError,
    LookupError,
    MemoryError,
    RuntimeError,
    TokenError,
)
"""Exceptions of zipfile and NumPy on damaged, encrypted or unsupported members, and on headers that are not Python."""


class NpzSequence(LaidOutSequence):
    """A mesh sequence in a NumPy archive that has at least ``points`` (frames, vertices, 3).

    Raises
    ------
    InputError
        If it is not an archive, is damaged, or its arrays do not fit together.
    """

    def __init__(self, path: Path | RemoteFile, *, fps: float | None) -> None:
        with _archive_errors(path), path.open("rb") as file, zipfile.ZipFile(file) as archive:
            members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            check_has_points(list(members), "array")

            def sliced(name: str) -> Any:
                header = _read_header(archive, members[name])
                stored = members[name].compress_type == zipfile.ZIP_STORED and not header.fortran_order
                return _StoredArray(path, members[name], header) if stored else _read(archive, members[name])

            self._points = sliced("points")
            self._take(list(members), lambda name: _read(archive, members[name]), fps, "array", sliced)


def write_npz(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write an uncompressed archive, block by block; equal sequences give equal bytes."""
    shape = (sequence.frame_count, sequence.vertex_count, 3)
    with output.whole_file() as partial, zipfile.ZipFile(partial, "w") as archive:
        points = (block for _, block in output.blocks(sequence, "NPZ"))
        _write_blocks(archive, "points", np.dtype("<f4"), shape, points)
        for name, field, shape_of_field in fields_as_arrays(sequence):
            values = (block for _, block in sequence.field_blocks(field.name))
            _write_blocks(archive, name, field.dtype.newbyteorder("<"), shape_of_field, values)
        for name, array in arrays_of(sequence, output.rate).items():
            with _new_member(archive, name) as member:
                np.lib.format.write_array(member, np.asarray(array, order="C"), version=(1, 0), allow_pickle=False)
    return ()


def _write_blocks(
    archive: zipfile.ZipFile, name: str, dtype: np.dtype[Any], shape: tuple[int, ...], blocks: Iterator[NDArray[Any]]
) -> None:
    with _new_member(archive, name) as member:
        descr = np.lib.format.dtype_to_descr(dtype)
        np.lib.format.write_array_header_1_0(member, {"descr": descr, "fortran_order": False, "shape": shape})
        for block in blocks:
            member.write(np.ascontiguousarray(block, dtype).data)


def _new_member(archive: zipfile.ZipFile, name: str) -> IO[bytes]:
    info = zipfile.ZipInfo(f"{name}.npy", date_time=EARLIEST_DATE)
    info.create_system = 3  # Unix on every system, for equal bytes
    return archive.open(info, "w", force_zip64=True)


@dataclass(frozen=True)
class _Header:
    """Header of an array in NumPy's format; `length` bytes precede the values."""

    shape: tuple[int, ...]
    fortran_order: bool
    dtype: np.dtype[Any]
    length: int


def _read_header(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> _Header:
    """Read and check the header of a member; ValueError if it is not an array."""
    with archive.open(info) as member:
        version = np.lib.format.read_magic(member)
        if version == (1, 0):
            found = np.lib.format.read_array_header_1_0(member)
        elif version == (2, 0):
            found = np.lib.format.read_array_header_2_0(member)
        else:
            raise InputError(
                f"{info.filename} has version {version} of NumPy's format; write it as version 1 or 2",
                code="unsupported-feature",
            )
        header = _Header(*found, member.tell())
    if header.dtype.hasobject:
        raise InputError(
            f"{info.filename} holds Python objects, which are never loaded; store numbers or text",
            code="unsupported-feature",
        )
    length = header.length + math.prod(header.shape) * header.dtype.itemsize
    if any(size < 0 for size in header.shape) or length != info.file_size:
        raise damaged(f"{info.filename} is damaged: its length is not what its header says; write it again")
    if info.file_size > DEFLATE_FACTOR * info.compress_size:
        raise damaged(f"{info.filename} is damaged: it claims more than its bytes can hold; write it again")
    return header


def _read(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    """Read a whole member; never executes anything stored in the file."""
    _read_header(archive, info)
    with archive.open(info) as member:
        array: NDArray[Any] = np.lib.format.read_array(member, allow_pickle=False)
    if array.dtype.kind != "U":
        return array
    # NumPy takes any number for a character, and raises SystemError when such text becomes a str.
    texts = np.ravel(array).astype(array.dtype.newbyteorder("="))
    if texts.view(np.uint32).max(initial=0) > sys.maxunicode:
        raise damaged(f"{info.filename} has characters that Unicode does not have; write it again")
    return array


class _StoredArray:
    """An uncompressed member in C order, sliced along its first dimension straight from the file.

    The member's checksum is not verified, since it covers the whole member.
    """

    def __init__(self, path: Path | RemoteFile, info: zipfile.ZipInfo, header: _Header) -> None:
        self.shape, self.dtype, self._path = header.shape, header.dtype, path
        # The data follow the local header, whose name and extra field may differ in length from the directory's.
        with path.open("rb") as file:
            file.seek(info.header_offset)
            local = file.read(LOCAL_HEADER_BYTES)
        name, extra = (int.from_bytes(local[at : at + 2], "little") for at in (26, 28))
        self._start = info.header_offset + LOCAL_HEADER_BYTES + name + extra + header.length
        self._row = math.prod(header.shape[1:])

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        start, stop, _ = rows.indices(self.shape[0])
        count = (stop - start) * self._row
        offset = self._start + start * self._row * self.dtype.itemsize
        with read_errors(self._path), self._path.open("rb") as file:
            file.seek(offset)
            numbers = np.empty(count, self.dtype)
            # The static type IO[bytes] lacks readinto, which every file here has.
            read = file.readinto(numbers.data.cast("B")) if count else 0  # type: ignore[attr-defined]
        if read < numbers.nbytes:
            raise damaged("the file ends early; write it again", path=self._path, frame=start, offset=offset)
        return numbers.reshape(stop - start, *self.shape[1:])


@contextmanager
def _archive_errors(path: Path | RemoteFile) -> Iterator[None]:
    try:
        with read_errors(path):
            yield
    except (*_DAMAGE, SyntaxError, TypeError, ValueError) as error:
        raise damaged(f"is not a readable NumPy archive ({error}); write it again", path=path) from error
