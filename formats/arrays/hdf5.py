"""HDF5: ``points`` in chunks of frames and, where known, faces, times and everything else.

The datasets are those of :mod:`pdecodec.formats.base.object_arrays`, text as UTF-8 of fixed length. A file of
``points`` alone is read too. Frames stream both ways: neither side holds more than a block of them.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.formats.base.object_arrays import LaidOutSequence, arrays_of, check_has_points
from pdecodec.formats.base.registry import Output
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import MeshSequence
from pdecodec.system.storage import RemoteFile

CHUNK_BYTES = 2**20
"""Size of a chunk of points: the cache that HDF5 gives a dataset by default."""


class Hdf5Sequence(LaidOutSequence):
    """A mesh sequence in an HDF5 file, which stays open until :meth:`close` and holds at least ``points``.

    Raises
    ------
    InputError
        If it is not HDF5, is damaged, or its datasets do not fit together.
    """

    def __init__(self, path: Path | RemoteFile, *, fps: float | None) -> None:
        self._path = path
        with _file_errors(path):
            self._file = h5py.File(path if isinstance(path, Path) else path.open(), "r")
        try:
            with _file_errors(path):
                names = _dataset_names(self._file)
                check_has_points(names, "dataset")
                self._points = self._file["points"]
                self._take(names, lambda name: _read(self._file[name]), fps, "dataset")
        except InputError:
            self._file.close()
            raise

    def read_frames(self, start: int, stop: int) -> Float32Array:
        with _file_errors(self._path, frame=start):
            return super().read_frames(start, stop)

    def close(self) -> None:
        self._file.close()


def write_hdf5(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write a sequence, block by block; the same sequence gives the same bytes."""
    frames, vertices = sequence.frame_count, sequence.vertex_count
    chunk = chunk_shape(frames, vertices)
    # As many frames at a time as a block holds, but no chunk in two pieces.
    at_a_time = max(chunk[0], sequence.frames_per_block // chunk[0] * chunk[0])
    with output.whole_file() as partial, new_hdf5(partial) as (file, check):
        points = file.create_dataset("points", (frames, vertices, 3), "<f4", chunks=chunk, track_times=False)
        for start, block in output.blocks(sequence, "HDF5", at_a_time):
            points[start : start + len(block)] = block
            check()
        for name, array in arrays_of(sequence, output.rate).items():
            _write(file, name, array)
    return ()


class _PatientFile(io.FileIO):
    """A file that takes what is written, though there be no room: HDF5 ends the process where a write fails.

    Attributes
    ----------
    failure : OSError or None
        What went wrong first.
    """

    failure: OSError | None = None

    def write(self, data: Any) -> int:
        left = memoryview(data).cast("B")
        size = len(left)
        try:
            while left and self.failure is None:
                left = left[super().write(left) or 0 :]
        except OSError as error:
            self.failure = error
        return size

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self.failure = self.failure or error
            return size or 0

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer).cast("B")
        count = super().readinto(view) or 0
        if self.failure is not None:
            # What could not be written is not there to be read.
            view[count:] = bytes(len(view) - count)
            count = len(view)
        return count


@contextmanager
def new_hdf5(path: Path) -> Iterator[tuple[Any, Callable[[], None]]]:
    """A new HDF5 file, and what raises the OSError that a write met; so does closing it."""
    with _PatientFile(path, "w+") as written:

        def check() -> None:
            if written.failure is not None:
                raise written.failure

        with h5py.File(written, "w") as file:
            yield file, check
        check()


def chunk_shape(frames: int, vertices: int) -> tuple[int, int, int]:
    """Whole frames to a chunk of :data:`CHUNK_BYTES`; of larger frames, a part."""
    vertices_of_chunk = min(vertices, CHUNK_BYTES // 12)
    return min(frames, max(1, CHUNK_BYTES // (12 * vertices))), vertices_of_chunk, 3


def _dataset_names(file: Any) -> list[str]:
    names: list[str] = []

    def note(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            names.append(name)

    file.visititems(note)
    return names


def _read(dataset: Any) -> NDArray[Any]:
    if h5py.check_string_dtype(dataset.dtype) is not None:
        return np.asarray(dataset.asstr()[()], dtype=np.str_)
    return np.asarray(dataset[()])


def _write(file: Any, name: str, array: NDArray[Any]) -> None:
    if array.dtype.kind == "U":
        encoded = np.char.encode(array, "utf-8")
        array = encoded.astype(h5py.string_dtype("utf-8", max(1, encoded.dtype.itemsize)))
    file.create_dataset(name, data=array, track_times=False)


@contextmanager
def _file_errors(path: Path | RemoteFile, *, frame: int | None = None) -> Iterator[None]:
    """Turn what h5py raises on damage into one line."""
    try:
        yield
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, AttributeError, MemoryError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"cannot be read as HDF5 ({reason}); check or write it again", path=path, frame=frame
        ) from error
