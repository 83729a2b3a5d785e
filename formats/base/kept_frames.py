"""Keep data of frames that were read, so that their files need not be parsed again."""

from __future__ import annotations

import shutil
import tempfile
import threading
import weakref
from collections.abc import Mapping
from contextlib import suppress
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.frame_data import DataKey
from pdecodec.mesh.sequence import BLOCK_BYTES

Positions = NDArray[Any]
"""Positions of a frame, in the number type of its file."""


class KeptPositions(dict[int, Positions]):
    """Positions of frames that were read for comparison, as many as fit in a block."""

    room = BLOCK_BYTES

    def keep(self, frame: int, points: Positions) -> None:
        if points.nbytes <= self.room:
            self.room -= points.nbytes
            self[frame] = points


class KeptData:
    """Decoded data of frames: in memory while they fit in a block, then in an unnamed temporary file.

    Nothing more is kept if the file cannot grow, or would take more than half of the free space.
    """

    def __init__(self) -> None:
        self._room = BLOCK_BYTES
        self._arrays: dict[int, dict[DataKey, NDArray[Any]]] = {}
        self._places: dict[int, dict[DataKey, tuple[int, np.dtype[Any], tuple[int, ...]]]] = {}
        self._file: IO[bytes] | None = None
        self._lock = threading.Lock()
        self._is_full = False

    def __contains__(self, frame: int) -> bool:
        return frame in self._arrays or frame in self._places

    def get(self, frame: int, key: DataKey) -> NDArray[Any] | None:
        """Return kept data of a frame; None if there are no data of this name."""
        if frame in self._arrays:
            return self._arrays[frame].get(key)
        place = self._places[frame].get(key)
        if place is None or self._file is None:
            return None
        begin, dtype, shape = place
        values = np.empty(shape, dtype)
        with self._lock:
            self._file.seek(begin)
            self._file.readinto(values.reshape(-1).view(np.uint8))  # type: ignore[attr-defined]
        return values

    def has_room(self, size: int, frames: int) -> bool:
        """Return whether data of this size [bytes], and as many for each of `frames` frames, can be kept."""
        if size <= self._room:
            return True
        if self._file is None and not self._is_full:
            self._is_full = 2 * size * frames > shutil.disk_usage(tempfile.gettempdir()).free
        return not self._is_full

    def keep(self, frame: int, values: Mapping[DataKey, NDArray[Any]]) -> None:
        """Keep all given data of a frame."""
        size = sum(one.nbytes for one in values.values())
        if size <= self._room:
            self._room -= size
            self._arrays[frame] = dict(values)
            return
        with self._lock, suppress(OSError):
            if self._file is None:
                self._file = tempfile.TemporaryFile()  # noqa: SIM115 - closed when this object is gone
                weakref.finalize(self, self._file.close)
            begin, places = self._file.seek(0, 2), {}
            for key, one in values.items():
                places[key] = begin, one.dtype, one.shape
                begin += self._file.write(np.ascontiguousarray(one).reshape(-1).view(np.uint8).data)
            self._file.flush()
            self._places[frame] = places
            return
        self._is_full = True
