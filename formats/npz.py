"""NPZ: a NumPy archive of ``points`` and, where known, faces, times and everything else.

The arrays are those of :mod:`pdecodec.formats.object_arrays`. Points stored without compression, as our writer
and ``numpy.savez`` store them, are read by blocks; compressed ones are loaded whole.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.formats.npy_member import StoredArray, read_array, read_header, write_header
from pdecodec.formats.object_arrays import arrays_of, is_layout_name, metadata_of, objects_of, padded_faces
from pdecodec.formats.stored_times import times_of_arrays
from pdecodec.sequence import Float32Array, MeshSequence, Progress, check_frame_range
from pdecodec.whole_output import whole_file

EARLIEST_DATE = (1980, 1, 1, 0, 0, 0)
"""The first date a zip file can say: same input, same bytes."""

_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    ValueError,
    EOFError,
    KeyError,
    NotImplementedError,
    RuntimeError,
    SyntaxError,
    TypeError,
    OverflowError,
    MemoryError,
)
"""What zipfile and numpy raise on damaged, encrypted or unsupported members, and on headers that are not Python."""


def open_npz(path: Path, *, fps: float | None) -> MeshSequence:
    """Open an archive that holds at least ``points`` (frames, vertices, 3).

    Raises
    ------
    InputError
        If it is not an archive, is damaged, or its arrays do not fit together.
    """
    return NpzSequence(path, fps=fps)


class NpzSequence(MeshSequence):
    """A mesh sequence in a NumPy archive.

    Parameters
    ----------
    path : pathlib.Path
    fps : float, optional
        See :func:`pdecodec.formats.open_sequence`.
    """

    def __init__(self, path: Path, *, fps: float | None = None) -> None:
        with _archive_errors(path), zipfile.ZipFile(path) as archive:
            members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            if "points" not in members:
                found = ", ".join(members) or "nothing"
                raise InputError(f"there is no array named points (it holds {found}); add it", path=path)
            self._points = _open_points(archive, members["points"], path)
            arrays = {
                name: read_array(archive, info)
                for name, info in members.items()
                if name != "points" and is_layout_name(name)
            }
        frames, vertices = self._points.shape[:2]
        self.objects = objects_of(arrays, vertices)
        self.metadata = metadata_of(arrays)
        self.times, self.fps, time_notices = times_of_arrays(arrays, frames, fps)
        other = [name for name in members if not is_layout_name(name)]
        self.notices = (*time_notices, f"arrays not kept: {', '.join(other)}") if other else time_notices

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        with np.errstate(over="ignore"):
            return np.array(self._points[start:stop], np.float32, order="C")


def write_npz(
    sequence: MeshSequence,
    path: Path,
    *,
    overwrite: bool = False,
    fps: float | None = None,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Write a sequence as an uncompressed archive, block by block; the same sequence gives the same bytes.

    Raises
    ------
    InputError
        If the place is taken or cannot be written to.
    """
    arrays: dict[str, NDArray[Any]] = {
        "times": sequence.times,
        "fps": np.asarray(sequence.fps if fps is None else fps, np.float64),
    }
    faces = padded_faces(sequence.objects)
    if faces is not None:
        arrays["faces"] = faces
    arrays.update(arrays_of(sequence.objects, sequence.metadata))
    with whole_file(path, overwrite=overwrite) as partial, zipfile.ZipFile(partial, "w") as archive:
        with _new_member(archive, "points") as member:
            write_header(member, (sequence.frame_count, sequence.vertex_count, 3), np.dtype("<f4"))
            for start, block in sequence.blocks():
                member.write(np.ascontiguousarray(block, "<f4").data)
                if progress is not None:
                    progress(start + len(block), sequence.frame_count, "writing NPZ")
        for name, array in arrays.items():
            with _new_member(archive, name) as member:
                np.lib.format.write_array(member, np.asarray(array, order="C"), version=(1, 0), allow_pickle=False)
    return ()


def _open_points(archive: zipfile.ZipFile, info: zipfile.ZipInfo, path: Path) -> StoredArray | NDArray[Any]:
    header = read_header(archive, info)
    shape, dtype = header.shape, header.dtype
    if len(shape) != 3 or shape[2] != 3 or dtype.kind not in "fiu":
        raise InputError(f"points must be numbers of shape (frames, vertices, 3), not {dtype} {shape}", path=path)
    if shape[1] == 0:
        raise InputError("points have no vertices; give at least one", path=path)
    if info.compress_type == zipfile.ZIP_STORED and not header.fortran_order:
        return StoredArray(path, info, header)
    return read_array(archive, info)


def _new_member(archive: zipfile.ZipFile, name: str) -> IO[bytes]:
    info = zipfile.ZipInfo(f"{name}.npy", date_time=EARLIEST_DATE)
    info.create_system = 3  # Unix on every system, for equal bytes
    return archive.open(info, "w", force_zip64=True)


@contextmanager
def _archive_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error}); check the file", path=path) from error
    except _DAMAGE as error:
        raise InputError(f"is not a readable NumPy archive ({error}); write it again", path=path) from error
