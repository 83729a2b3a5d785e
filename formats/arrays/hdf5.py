"""Read and write HDF5: ``points`` in chunks of frames and, if known, faces, times and everything else.

The datasets are those of :mod:`pdecodec.formats.base.object_arrays`; text is UTF-8 of fixed length. Files with only
``points`` are read too. Frames are streamed in both directions, a block at a time.
"""

from __future__ import annotations

import glob
import io
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged
from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.object_arrays import LaidOutSequence, arrays_of, check_has_points, fields_as_arrays
from pdecodec.formats.base.registry import Output
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import Content, MeshSequence, check_frame_range
from pdecodec.system.reading import FileScope
from pdecodec.system.storage import RemoteFile

CHUNK_BYTES = 2**20
"""Size of a chunk of points [bytes]: HDF5's default chunk cache per dataset."""

MAX_VIRTUAL_DEPTH = 8
"""Largest depth of virtual datasets that refer to each other."""

MAX_LINKS = 16
"""Largest number of links that are followed in a row; HDF5 has the same limit."""

HDF5_DAMAGE = (
    *(OSError, LookupError, ValueError, TypeError, ArithmeticError, RuntimeError, AttributeError, MemoryError),
    SystemError,  # h5py raises it when it loses its lock on an exception
)
"""Exceptions of h5py and NumPy on damaged or missing parts."""

_UNLIMITED = 2**63
"""Smallest count that HDF5 uses to mark a selection that grows with its dataset."""


_SCALES = frozenset({"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "DIMENSION_LABELS", "_Netcdf4Dimid"})
"""Attributes that connect datasets with their dimension scales."""


class Hdf5Sequence(LaidOutSequence):
    """A mesh sequence in an HDF5 file that has at least ``points``; the file stays open until :meth:`close`.

    Raises
    ------
    InputError
        If it is not HDF5, is damaged, or its datasets do not fit together.
    """

    def __init__(self, path: Path | RemoteFile, *, fps: float | None) -> None:
        self._path, scope = path, FileScope(path)
        with _file_errors(path):
            self._file = h5py.File(path if isinstance(path, Path) else path.open(), "r")
        try:
            with _file_errors(path):
                linked, lost = _dataset_names(self._file, scope), _attribute_names(self._file)
                check_has_points(list(linked), "dataset")
                # HDF5 refuses to list a file while a dataset with external data is open.
                containers = list(_containers(self._file, lost))

                def item(name: str) -> Any:
                    return linked_item(self._file, name, scope) if linked[name] else _found(self._file[name])

                def sliced(name: str) -> Any:
                    dataset = item(name)
                    check_stored(dataset, scope)
                    return dataset

                self._points = sliced("points")
                self._take(list(linked), lambda name: _read(item(name), scope), fps, "dataset", sliced)
            self._contents += containers
            self.notices = (*self.notices, *not_kept(lost, "attributes not kept: {}"))
        except InputError:
            self._file.close()
            raise

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        with _file_errors(self._path, frame=start):
            return super().read_frames(start, stop)

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        with _file_errors(self._path, frame=start):
            return super()._field_values(field, start, stop)

    def close(self) -> None:
        self._file.close()


def write_hdf5(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write a sequence, block by block; equal sequences give equal bytes."""
    frames, vertices = sequence.frame_count, sequence.vertex_count
    chunk = chunk_shape(frames, vertices)
    # Write whole chunks: as many frames at a time as fit in a block.
    at_a_time = max(chunk[0], sequence.frames_per_block // chunk[0] * chunk[0])
    with output.whole_file() as partial, new_hdf5(partial) as (file, check):
        points = file.create_dataset("points", (frames, vertices, 3), "<f4", chunks=chunk, track_times=False)
        for start, block in output.blocks(sequence, "HDF5", at_a_time):
            points[start : start + len(block)] = block
            check()
        for name, field, shape in fields_as_arrays(sequence):
            values = file.create_dataset(name, shape, field.dtype, track_times=False)
            for start, block in sequence.field_blocks(field.name):
                values[start : start + len(block)] = block
                check()
        for name, array in arrays_of(sequence, output.rate).items():
            _write(file, name, array)
    return ()


class _DeferredErrorFile(io.FileIO):
    """A file that hides write errors from HDF5, which aborts the process if a write fails.

    Attributes
    ----------
    failure : OSError or None
        The first error.
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
            # Return zeros for data that could not be written.
            view[count:] = bytes(len(view) - count)
            count = len(view)
        return count


@contextmanager
def new_hdf5(path: Path, *, track_order: bool = False) -> Iterator[tuple[Any, Callable[[], None]]]:
    """Create an HDF5 file; yield it with a function that raises the OSError of a failed write, as closing does.

    `track_order` records in which order datasets were created.
    """
    with _DeferredErrorFile(path, "w+") as written:

        def check() -> None:
            if written.failure is not None:
                raise written.failure

        with h5py.File(written, "w", track_order=track_order) as file:
            yield file, check
        check()


def chunk_shape(frames: int, vertices: int) -> tuple[int, int, int]:
    """Return a chunk of whole frames up to :data:`CHUNK_BYTES`, or a part of one larger frame."""
    vertices_of_chunk = min(vertices, CHUNK_BYTES // 12)
    return min(frames, max(1, CHUNK_BYTES // (12 * vertices))), vertices_of_chunk, 3


def _dataset_names(file: Any, scope: FileScope) -> dict[str, bool]:
    """Return the names of all datasets, and whether each is a link; InputError if a link is broken."""
    names: list[str] = []
    links: list[str] = []

    def note(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            names.append(name)

    def note_link(name: str, link: Any) -> None:
        if not isinstance(link, h5py.HardLink):
            links.append(name)

    file.visititems(note)
    file.visititems_links(note_link)
    linked = [name for name in links if isinstance(linked_item(file, name, scope), h5py.Dataset)]
    return dict.fromkeys(linked, True) | dict.fromkeys(names, False)


def _attribute_names(file: Any) -> list[str]:
    """Return the names of attributes of groups and datasets, except those for dimension scales."""
    names = list(file.attrs)
    file.visititems(lambda name, item: names.extend(f"{name}.{key}" for key in item.attrs))
    return [name for name in names if name.rpartition(".")[2] not in _SCALES]


def _containers(file: Any, lost: Sequence[str]) -> Iterator[Content]:
    """List the groups of a file, and its attributes, of which `lost` are not kept."""
    groups: list[str] = []
    file.visititems(lambda name, item: groups.append(name) if isinstance(item, h5py.Group) else None)
    yield from (Content(f"/{name}", "groups", "implied") for name in groups)
    yield from (Content(f"/{name}", "attributes", "dropped") for name in lost)


def linked_item(file: Any, name: str, scope: FileScope) -> Any:
    """Return the object under a name in an HDF5 file, None if there is none.

    Raises
    ------
    InputError
        If it is a broken link, or a link on the way leads to a file outside the scope.
    """
    _check_links(file, name, scope, 0)
    item = _found(file.get(name))
    link = file.get(name, getlink=True) if item is None and name in file else None
    if isinstance(link, h5py.ExternalLink | h5py.SoftLink):
        place = repr(link.filename) if isinstance(link, h5py.ExternalLink) else "the file itself"
        raise InputError(
            f"{name!r} is a link to {link.path!r} in {place}, which is missing; restore it",
            code="file-missing",
            path=scope.path,
        )
    return item


def _found(item: Any) -> Any:
    """Return an object of a file; datasets with external data look for these in the folder of the file.

    By default HDF5 would look in the current folder.
    """
    if not isinstance(item, h5py.Dataset) or item.external is None:
        return item
    home, name = item.file, item.name
    item.id.close()  # an open dataset keeps the access properties it was opened with
    access = h5py.h5p.create(h5py.h5p.DATASET_ACCESS)
    access.set_efile_prefix(b"${ORIGIN}")
    return h5py.Dataset(h5py.h5d.open(home.id, name.encode(), access))


def _check_links(file: Any, name: str, scope: FileScope, depth: int) -> None:
    """Raise InputError if a link on the way to a name leads outside the scope, before HDF5 follows it."""
    group, parts = file, [part for part in name.split("/") if part not in ("", ".")]
    while parts:
        link = group.get(parts[0], getlink=True)
        if isinstance(link, h5py.HardLink):
            group, parts = group.get(parts[0]), parts[1:]
            if not isinstance(group, h5py.Group):
                return
            continue
        if depth >= MAX_LINKS:
            raise InputError(f"{name!r} is behind more than {MAX_LINKS} links", code="too-large", path=scope.path)
        rest = "/".join(parts[1:])
        if isinstance(link, h5py.SoftLink):
            _check_links(file if link.path.startswith("/") else group, f"{link.path}/{rest}", scope, depth + 1)
        elif isinstance(link, h5py.ExternalLink):
            there = find_referenced_file(link.filename, file.file, scope, f"{name!r} is a link to {link.path!r} in")
            with h5py.File(there, "r") as other:
                _check_links(other, f"{link.path}/{rest}", scope, depth + 1)
        return


def check_stored(dataset: Any, scope: FileScope, depth: int = 0) -> None:
    """Raise InputError if values of a dataset were never written: HDF5 would return its fill value for them.

    Parameters
    ----------
    dataset : h5py.Dataset
        Its chunks and the sources of a virtual dataset are examined, not its values.
    scope : FileScope
        Folder of files that may hold its values.
    depth : int
        Number of virtual datasets between the one that is read and this one.
    """
    if dataset.size in (None, 0):
        return
    name, path = dataset.name, _home(dataset, scope)
    if depth > MAX_VIRTUAL_DEPTH:
        raise InputError(
            f"dataset {name!r} is made of more than {MAX_VIRTUAL_DEPTH} virtual datasets in a row",
            code="too-large",
            path=path,
        )
    if dataset.is_virtual:
        _check_sources(dataset, scope, depth)
    elif dataset.chunks is not None:
        total = math.prod(-(-size // chunk) for size, chunk in zip(dataset.shape, dataset.chunks, strict=True))
        written = dataset.id.get_num_chunks()
        if written < total:
            raise damaged(
                f"{total - written} of {total} chunks of dataset {name!r} were never written; write the file again",
                path=path,
            )
    elif dataset.external is not None:
        for file, _, _ in dataset.external:
            find_referenced_file(
                str(file), dataset.file, scope, f"dataset {name!r} has its values in", of_raw_data=True
            )
    elif dataset.id.get_space_status() == h5py.h5d.SPACE_STATUS_NOT_ALLOCATED:
        raise damaged(f"dataset {name!r} was never written; write the file again", path=path)


def _home(dataset: Any, scope: FileScope) -> Path | RemoteFile:
    """Return the path of the file that holds a dataset, which may be the target of a link."""
    return Path(dataset.file.filename) if isinstance(scope.path, Path) else scope.path


def _check_sources(dataset: Any, scope: FileScope, depth: int) -> None:
    """Raise InputError if a source of a virtual dataset is missing or too small, or some values have no source."""
    covered, is_open, path = 0, False, _home(dataset, scope)
    for space, pattern, source_name, selected in dataset.virtual_sources():
        numbers: Iterable[int] = (0,)
        if space.is_regular_hyperslab():
            start, stride, count, _ = space.get_regular_hyperslab()
            open_axes = [axis for axis, number in enumerate(count) if number >= _UNLIMITED]
            if open_axes:
                is_open = True
                count_there = -(-(dataset.shape[open_axes[0]] - start[open_axes[0]]) // stride[open_axes[0]])
                numbers = range(count_there)
                if _has_later_file(pattern, path, count_there):
                    numbers = range(count_there + 1)  # HDF5 ends the virtual dataset before the first missing file
        count = 0 if is_open else space.get_select_npoints()
        covered += count
        for number in numbers if "%b" in pattern + source_name else (0,):
            file_name, inner = (text.replace("%b", str(number)) for text in (pattern, source_name))
            if file_name == ".":
                source = _source(dataset.file, inner, scope)
                _check_extent(source, selected, count, path)
                check_stored(source, scope, depth + 1)
                continue
            file_path = find_referenced_file(
                file_name, dataset.file, scope, f"dataset {dataset.name!r} has its values in"
            )
            with h5py.File(file_path, "r") as file:
                source = _source(file, inner, scope)
                if source is None:
                    raise InputError(
                        f"has no dataset {inner!r}, which {dataset.name!r} is made of",
                        code="damaged-input",
                        path=file_path,
                    )
                _check_extent(source, selected, count, file_path)
                check_stored(source, scope, depth + 1)
    if not is_open and covered < dataset.size:
        lost = dataset.size - covered
        raise damaged(
            f"{lost} of {dataset.size} values of the virtual dataset {dataset.name!r} have no source; write it again",
            path=path,
        )


def _check_extent(source: Any, selected: Any, count: int, path: Path | RemoteFile) -> None:
    """Raise InputError if a source has fewer values than the `count` that a virtual dataset takes from it."""
    if selected.get_select_type() == h5py.h5s.SEL_ALL:
        if source.size < count:
            raise InputError(
                f"its dataset {source.name!r} has {source.size} values, a virtual dataset needs {count} of it",
                code="damaged-input",
                path=path,
            )
        return
    if selected.is_regular_hyperslab() and max(selected.get_regular_hyperslab()[2]) >= _UNLIMITED:
        return
    else:
        wanted = tuple(last + 1 for last in selected.get_select_bounds()[1])
    if len(wanted) != source.ndim or any(size > there for size, there in zip(wanted, source.shape, strict=True)):
        raise InputError(
            f"its dataset {source.name!r} has shape {source.shape}, a virtual dataset needs {tuple(wanted)} of it",
            code="damaged-input",
            path=path,
        )


def _has_later_file(pattern: str, path: Path | RemoteFile, first: int) -> bool:
    """Return whether a file next to `path` has a number from `first` on in place of ``%b`` in a pattern."""
    if not isinstance(path, Path) or "%b" not in pattern:
        return False
    head, _, tail = Path(pattern).name.partition("%b")
    folder = path.absolute().parent / Path(pattern).parent
    numbers = (one.name.removeprefix(head).removesuffix(tail) for one in folder.glob(f"{glob.escape(head)}*"))
    return any(number.isdecimal() and int(number) >= first for number in numbers)


def _source(file: Any, name: str, scope: FileScope) -> Any:
    """Return a source of a virtual dataset, None if it is missing; InputError if its raw data are outside the scope.

    HDF5 opens the source itself, and looks for raw data in the current folder.
    """
    _check_links(file, name, scope, 0)
    source = file.get(name)
    if not isinstance(source, h5py.Dataset):
        return None
    for raw, _, _ in source.external or ():
        scope.regular(str(raw), Path())
    return source


def find_referenced_file(name: str, file: Any, scope: FileScope, what: str, *, of_raw_data: bool = False) -> Path:
    """Return the path of a file that an HDF5 file names, searched where HDF5 searches.

    Parameters
    ----------
    name : str
    file : h5py.File
        The file that names it.
    scope : FileScope
    what : str
        Beginning of a message: what names the file.
    of_raw_data : bool
        Whether to search only the folder of `file`, as HDF5 does for raw data.

    Raises
    ------
    InputError
        If it is missing, no regular file, or outside the scope.
    """
    path = Path(file.filename) if isinstance(scope.path, Path) else None
    folders = [] if path is None else [path.absolute().parent, path.resolve().parent]
    places = [(folder, part) for folder in folders for part in (name, os.path.basename(name))]
    for folder, part in places[:1] if of_raw_data and places else [*places, (Path(), name)]:
        if "\0" not in name and os.path.lexists(folder / part):
            return scope.regular(part, folder)
    raise InputError(f"{what} {name!r}, which is missing; restore that file", code="file-missing", path=path)


def _read(dataset: Any, scope: FileScope) -> NDArray[Any]:
    check_stored(dataset, scope)
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
    """Turn exceptions of h5py on damage into one InputError."""
    try:
        yield
    except InputError:
        raise
    except HDF5_DAMAGE as error:
        has_text = str(error) and not isinstance(error, SystemError)  # of which the text is an address in memory
        reason = str(error).splitlines()[0] if has_text else type(error).__name__
        raise InputError(
            f"cannot be read as HDF5 ({reason}); check or write it again", code="unreadable", path=path, frame=frame
        ) from error
