"""Room on a disk that is kept for a file before it is written."""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
from pathlib import Path

KEEP_SIZE = 1
"""Linux' FALLOC_FL_KEEP_SIZE: room is made behind the end of a file, which stays where it is."""

MARGIN = 2**20
"""Bytes beyond what was asked for."""


class ReservedRoom:
    """Room for a file that something else writes: what cannot report a full disk meets none.

    Where a file system cannot keep room, it is only looked at how much there is. What is left over goes with the file's
    last change of length, or when it is moved: it never counts as its size.

    Parameters
    ----------
    path : pathlib.Path
        Of the file, which is there.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._wanted = path, 0

    def reserve(self, more: int) -> None:
        """Keep room for so many more bytes; OSError where there is none."""
        self._wanted += more
        with self._path.open("r+b", buffering=0) as file:
            failure = _allocate(file.fileno(), self._wanted + MARGIN)
        if failure == errno.ENOSPC:
            raise OSError(failure, os.strerror(failure), str(self._path))
        left = self._wanted + MARGIN - self._path.stat().st_size
        if failure and shutil.disk_usage(self._path.parent).free < left:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._path))

    def release(self) -> None:
        """Give back what the file did not need."""
        size = self._path.stat().st_size
        # A length that stays as it is changes nothing on some file systems.
        for length in (size + 1, size):
            os.truncate(self._path, length)


def _allocate(file: int, length: int) -> int:
    """Allocate the first bytes of a file; an error number, or 0."""
    try:
        allocate = ctypes.CDLL(None, use_errno=True).fallocate64
    except (AttributeError, OSError, TypeError):
        return errno.ENOTSUP
    allocate.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_int64, ctypes.c_int64)
    return ctypes.get_errno() if allocate(file, KEEP_SIZE, 0, length) else 0
