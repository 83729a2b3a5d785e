"""HDF5: ``points`` in chunks of frames and, where known, faces, times and everything else.

The datasets are those of :mod:`pdecodec.formats.object_arrays`, text as UTF-8 of fixed length. A file of
``points`` alone is read too. Frames stream both ways: neither side holds more than a block of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.formats.object_arrays import arrays_of, is_layout_name, metadata_of, objects_of, padded_faces
from pdecodec.formats.stored_times import times_of_arrays
from pdecodec.sequence import Float32Array, MeshSequence, Progress, check_frame_range
from pdecodec.whole_output import whole_file

CHUNK_BYTES = 2**20
"""Size of a chunk of points: the cache that HDF5 gives a dataset by default."""


def open_hdf5(path: Path, *, fps: float | None) -> MeshSequence:
    """Open a file that holds at least the dataset ``points`` (frames, vertices, 3).

    Raises
    ------
    InputError
        If it is not HDF5, is damaged, or its datasets do not fit together.
    """
    return Hdf5Sequence(path, fps=fps)


class Hdf5Sequence(MeshSequence):
    """A mesh sequence in an HDF5 file, which stays open until :meth:`close`.

    Parameters
    ----------
    path : pathlib.Path
    fps : float, optional
        See :func:`pdecodec.formats.open_sequence`.
    """

    def __init__(self, path: Path, *, fps: float | None = None) -> None:
        self._path = path
        with _file_errors(path):
            self._file = h5py.File(path, "r")
        try:
            with _file_errors(path):
                names = _dataset_names(self._file)
                self._points = self._open_points(names)
                arrays = {name: _read(self._file[name]) for name in names if name != "points" and is_layout_name(name)}
            frames, vertices = self._points.shape[:2]
            self.objects = objects_of(arrays, vertices)
            self.metadata = metadata_of(arrays)
            self.times, self.fps, time_notices = times_of_arrays(arrays, frames, fps)
        except InputError:
            self._file.close()
            raise
        other = [name for name in names if not is_layout_name(name)]
        self.notices = (*time_notices, f"datasets not kept: {', '.join(other)}") if other else time_notices

    def _open_points(self, names: list[str]) -> Any:
        if "points" not in names:
            found = ", ".join(names) or "nothing"
            raise InputError(f"there is no dataset named points (it holds {found}); add it", path=self._path)
        points = self._file["points"]
        if points.ndim != 3 or points.shape[2] != 3 or points.dtype.kind not in "fiu":
            raise InputError(
                f"points must be numbers of shape (frames, vertices, 3), not {points.dtype} {points.shape}",
                path=self._path,
            )
        if points.shape[1] == 0:
            raise InputError("points have no vertices; give at least one", path=self._path)
        return points

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        with _file_errors(self._path, frame=start), np.errstate(over="ignore"):
            return np.asarray(self._points[start:stop]).astype(np.float32, copy=False)

    def close(self) -> None:
        self._file.close()


def write_hdf5(
    sequence: MeshSequence,
    path: Path,
    *,
    overwrite: bool = False,
    fps: float | None = None,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Write a sequence, block by block; the same sequence gives the same bytes.

    Raises
    ------
    InputError
        If the place is taken or cannot be written to.
    """
    with whole_file(path, overwrite=overwrite) as partial, h5py.File(partial, "w") as file:
        vertices = sequence.vertex_count
        points = file.create_dataset(
            "points",
            shape=(sequence.frame_count, vertices, 3),
            dtype="<f4",
            chunks=chunk_shape(sequence.frame_count, vertices),
            track_times=False,
        )
        for start, block in sequence.blocks(_frames_of_whole_chunks(sequence)):
            points[start : start + len(block)] = block
            if progress is not None:
                progress(start + len(block), sequence.frame_count, "writing HDF5")
        _write(file, "times", sequence.times)
        _write(file, "fps", np.asarray(sequence.fps if fps is None else fps, np.float64))
        faces = padded_faces(sequence.objects)
        if faces is not None:
            _write(file, "faces", faces)
        for name, array in arrays_of(sequence.objects, sequence.metadata).items():
            _write(file, name, array)
    return ()


def chunk_shape(frames: int, vertices: int) -> tuple[int, int, int]:
    """Whole frames to a chunk of :data:`CHUNK_BYTES`; of larger frames, a part."""
    vertices_of_chunk = min(vertices, CHUNK_BYTES // 12)
    return min(frames, max(1, CHUNK_BYTES // (12 * vertices))), vertices_of_chunk, 3


def _frames_of_whole_chunks(sequence: MeshSequence) -> int:
    """Frames to write at a time: as many as a block holds, but no chunk in two pieces."""
    chunk = chunk_shape(sequence.frame_count, sequence.vertex_count)[0]
    return max(chunk, sequence.frames_per_block // chunk * chunk)


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
def _file_errors(path: Path, *, frame: int | None = None) -> Iterator[None]:
    """Turn what h5py raises on damage into one line."""
    try:
        yield
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, AttributeError, MemoryError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"cannot be read as HDF5 ({reason}); check or write it again", path=path, frame=frame
        ) from error
