"""Remote files: addresses such as ``https://host/walk.pdeanim`` or ``s3://bucket/walk.h5``, accessed by fsspec.

All protocols of `fsspec` can be read and, if the protocol supports it, written: S3 (with the package s3fs), HTTP,
and others.
"""

from __future__ import annotations

import io
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO, Literal
from urllib.parse import urlsplit

from pdecodec.errors import InputError, MissingExtraError, PdecodecError
from pdecodec.system.whole_output import output_exists

ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+(::[A-Za-z][A-Za-z0-9+.-]+)*://")
"""Beginning of an address; a drive letter is not a protocol."""

HEAD_BYTES = 1024
"""Bytes that are read at first; a table of sections is shorter."""

MAX_READ_AHEAD_BYTES = 2**20
"""Largest number of bytes that are read ahead: beyond it, separate requests for parts cost little."""

COPY_BYTES = 2**20
"""Bytes that are read and written at a time."""

CHANGE_MARKS = (
    "ETag",
    "etag",
    "Content-MD5",
    "md5",
    "Digest",
    "generation",
    "LastModified",
    "Last-Modified",
    "mtime",
    "created",
)
"""Properties from which a storage service tells that a file has changed."""

RANGE_NOT_SATISFIABLE = 416
"""HTTP status for a requested range that begins beyond the end of the file."""


def is_address(place: str | os.PathLike[str]) -> bool:
    """Whether this is the address of a remote file rather than a path."""
    return isinstance(place, str) and ADDRESS.match(place) is not None


class RemoteFile:
    """A file at an address, with the parts of a path that readers need: name, extension, and :meth:`open`.

    Parameters
    ----------
    address : str

    Raises
    ------
    MissingExtraError
        If fsspec, or a package that it needs for the protocol, is not installed.
    InputError
        If there is no such protocol.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        try:
            from fsspec.core import url_to_fs
        except ModuleNotFoundError as error:
            raise _missing_extra(error, address) from error
        with storage_errors(address):
            self.storage, self._path = url_to_fs(address)

    def __fspath__(self) -> str:
        return self.address

    def __str__(self) -> str:
        return self.address

    @property
    def name(self) -> str:
        """The last part of the address, without the query for a server."""
        return PurePosixPath(urlsplit(self.address).path or self.address).name

    @property
    def suffix(self) -> str:
        return PurePosixPath(self.name).suffix

    def open(self, mode: Literal["rb"] = "rb") -> BinaryIO:
        """Open it as a seekable file, read in blocks of which the latest are cached."""
        with storage_errors(self.address):
            file: BinaryIO = self.storage.open(self._path, mode, block_size=COPY_BYTES, cache_type="blockcache")
            return file

    def exists(self) -> bool:
        with storage_errors(self.address):
            return bool(self.storage.exists(self._path))

    def size(self) -> int:
        """Return its size [bytes]; InputError if there is no such file, or the server does not tell."""
        size = self._information().get("size")
        if size is None:
            raise InputError(
                "the server does not tell its size; download it and read the copy",
                code="unreadable",
                path=self.address,
            )
        return int(size)

    def stamp(self) -> list[Any]:
        """Return name, size, and properties that change when the file is written; None for these if there are none."""
        known = self._information()
        marks = [str(known[name]) for name in CHANGE_MARKS if known.get(name) is not None]
        return [self.name, known.get("size"), marks or None]

    def read_range(self, begin: int, end: int) -> bytes:
        """Return bytes `begin` to `end` - 1."""
        with storage_errors(self.address):
            data: bytes = self.storage.cat_file(self._path, start=begin, end=end)
        if len(data) < end - begin:
            raise InputError("became shorter while it was read; open it again", code="file-changed", path=self.address)
        if len(data) > end - begin:
            raise InputError(
                "the server does not send parts of files; download it and read the copy",
                code="unreadable",
                path=self.address,
            )
        return data

    def read(self) -> bytes:
        """Return all of its bytes."""
        with storage_errors(self.address):
            data: bytes = self.storage.cat_file(self._path)
            return data

    def write(self, data: bytes) -> None:
        """Write the whole file; storages show it only when it is complete."""
        with storage_errors(self.address):
            self.storage.makedirs(self.storage._parent(self._path), exist_ok=True)
            self.storage.pipe_file(self._path, data)

    def fetch(self, path: Path) -> None:
        """Write its bytes to a path."""
        with self.open() as source, path.open("wb") as target:
            while True:
                with storage_errors(self.address):
                    piece = source.read(COPY_BYTES)
                if not piece:
                    return
                target.write(piece)

    def put(self, path: Path) -> None:
        """Write the bytes of a local file here; storages show them only when they are complete."""
        with storage_errors(self.address):
            self.storage.makedirs(self.storage._parent(self._path), exist_ok=True)
            self.storage.put_file(str(path), self._path)

    def _information(self) -> dict[str, Any]:
        with storage_errors(self.address):
            found: dict[str, Any] = self.storage.info(self._path)
            return found


class RangeReader(io.RawIOBase):
    """A remote file that reads no more than requested, except for its first bytes, which are read and kept.

    Attributes
    ----------
    name : str
    bytes_read : int
        Number of bytes transferred.
    """

    def __init__(self, file: RemoteFile) -> None:
        self._file, self.name = file, file.address
        self._size, self._at = file.size(), 0
        self._head = file.read_range(0, min(HEAD_BYTES, self._size)) if self._size else b""
        self.bytes_read = len(self._head)

    @property
    def head(self) -> bytes:
        """The first bytes of the file, which are kept."""
        return self._head

    def read_ahead(self, end: int) -> None:
        """Read and keep all bytes before `end`, up to MAX_READ_AHEAD_BYTES, by one request."""
        begin, end = len(self._head), min(end, self._size, MAX_READ_AHEAD_BYTES)
        if begin < end:
            self._head += self._file.read_range(begin, end)
            self.bytes_read += end - begin

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer).cast("B")
        end = min(self._at + len(view), self._size)
        count = max(0, end - self._at)
        known = self._head[self._at : end]
        begin = self._at + len(known)
        data = known if begin >= end else known + self._file.read_range(begin, end)
        self.bytes_read += max(0, end - begin)
        view[:count] = data
        self._at += count
        return count


def open_range_reader(address: str) -> RangeReader:
    """Open a remote file for reading parts of it."""
    return RangeReader(RemoteFile(address))


@contextmanager
def remote_output(address: str, *, overwrite: bool) -> Iterator[Path]:
    """Yield a path to write to; its file is put at the address if the block succeeds.

    Raises
    ------
    InputError
        If there already is a file and `overwrite` is false, or nothing can be put there.
    """
    file = RemoteFile(address)
    if not overwrite and file.exists():
        raise output_exists(address)
    with tempfile.TemporaryDirectory(prefix="pdecodec-") as folder:
        path = Path(folder) / file.name
        yield path
        if not path.is_file():
            raise InputError(
                "stands for several files; give the address of one file", code="ambiguous-input", path=address
            )
        file.put(path)


@contextmanager
def storage_errors(address: str) -> Iterator[None]:
    """Turn the many kinds of errors of storage services into errors of one line."""
    try:
        yield
    except PdecodecError:
        raise
    except ImportError as error:
        raise _missing_extra(error, address) from error
    except FileNotFoundError as error:
        raise InputError("no such file, or no answer; check the address", code="file-missing", path=address) from error
    except PermissionError as error:
        raise InputError(
            "access is denied with the credentials of this machine; check them", code="unreadable", path=address
        ) from error
    except Exception as error:
        if getattr(error, "status", None) == RANGE_NOT_SATISFIABLE:
            raise InputError(
                "became shorter while it was read; open it again", code="file-changed", path=address
            ) from error
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"cannot be reached or read ({reason}); check the address", code="unreadable", path=address
        ) from error


def _missing_extra(error: ImportError, address: str) -> MissingExtraError:
    name = error.name or str(error)
    return MissingExtraError(f"addresses need the package {name}; run: pip install 'pdecodec[remote]'", path=address)
