"""Outputs that appear whole or not at all: written under a temporary name in the same folder, then moved.

Unfinished output is a hidden file or folder whose name tells which process writes it. Several files, such as frames,
become visible together: their folder is renamed to mark it as ready, and its files are moved. A killed process
leaves unfinished or ready output; the next process that reads or writes in that folder removes unfinished output and
moves ready output.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import hashlib
import json
import math
import os
import platform
import re
import shutil
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from pdecodec.errors import InputError, unreadable

PARTIAL, READY = ".partial", ".ready"
"""Suffixes of names: for unfinished output, and for complete output that remains to be moved."""

MANIFEST = ".manifest.json"
"""File in a ready folder that lists the names of its files that replace others, and of the files to remove."""

NAME_CHARACTERS = 24
"""Number of characters of an output's name in its temporary name. At four bytes each, and with its other parts,
the temporary name stays below 143 bytes, the smallest limit of a file system in use (eCryptfs).
"""

PROBE_BYTES = 2**16
"""Bytes that are written to find out whether a disk is full."""

_OWN = re.compile(r"\..+\.(?P<host>[0-9a-f]{8})-(?P<process>\d+)-[0-9a-f]{8}(\.partial|\.ready)", re.DOTALL)


def check_path(path: Path) -> None:
    """Raise InputError if no file can have this path."""
    try:
        os.lstat(path)
    except ValueError as error:
        raise InputError(
            "holds a character that paths cannot have (NUL, or half of a surrogate pair); give another name",
            code="output-unwritable",
            path=path,
        ) from error
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise InputError(
                "is longer than names may be in this folder; give a shorter one", code="output-unwritable", path=path
            ) from error


def check_writable(path: Path, *, overwrite: bool, through_links: bool = True) -> None:
    """Raise InputError if `path` cannot become an output file; call it before long work starts."""
    check_path(path)
    if path.is_dir() and (through_links or not path.is_symlink()):
        raise InputError("is a folder; name a file in it", code="output-unwritable", path=path)
    if os.path.lexists(path) and not overwrite:
        raise output_exists(path)
    place = (_link_target(path) if through_links else path).parent
    _check_folder(place)
    if not os.access(place, os.W_OK):
        raise InputError(
            "this folder is not writable; choose another, or change its permissions",
            code="output-unwritable",
            path=place,
        )


@contextmanager
def whole_file(path: Path, *, overwrite: bool, through_links: bool = True) -> Iterator[Path]:
    """Yield a path to write to, which becomes `path` if the block succeeds and is removed if not.

    A link is written through, unless `through_links` is false: then it is replaced. A replaced file passes on its
    mode.

    Raises
    ------
    InputError
        If `path` exists, or appears meanwhile, and `overwrite` is false, is a folder, or cannot be written.
    """
    check_writable(path, overwrite=overwrite, through_links=through_links)
    place = _link_target(path) if through_links else path
    finish_interrupted(place.parent)
    partial = partial_path(place)
    try:
        with write_errors(path):
            yield partial
            move_into(partial, path, overwrite=overwrite, through_links=through_links)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def partial_folder(place: Path) -> Iterator[Path]:
    """Yield a new empty folder next to `place`, removed after the block unless it was renamed.

    Raises
    ------
    InputError
        If it cannot be made.
    """
    _check_folder(place.parent)
    finish_interrupted(place.parent)
    partial = partial_path(place)
    with write_errors(place):
        partial.mkdir()
    try:
        yield partial
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def publish(partial: Path, names: Sequence[str], *, overwrite: bool, remove: Sequence[str] = ()) -> None:
    """Move files of a partial folder to its parent folder: all of them, even if the process is interrupted.

    Parameters
    ----------
    partial : pathlib.Path
    names : sequence of str
        Names of files in it; they replace existing files if `overwrite` is true.
    overwrite : bool
    remove : sequence of str
        Names of files in the parent folder to remove.

    Raises
    ------
    InputError
        If a file exists and may not be replaced; nothing is moved then.
    """
    folder = partial.parent
    taken = [] if overwrite else [name for name in names if os.path.lexists(folder / name)]
    if taken:
        raise output_exists(folder / taken[0])
    (partial / MANIFEST).write_text(json.dumps({"move": list(names), "remove": list(remove)}), encoding="utf-8")
    ready = partial.with_name(partial.name.removesuffix(PARTIAL) + READY)
    os.replace(partial, ready)
    _finish_ready(ready)


def finish_interrupted(folder: Path) -> None:
    """Complete or remove output that killed processes of this machine and user left in a folder."""
    try:
        left = [entry for entry in os.scandir(folder) if entry.name.startswith(".")]
    except OSError:
        return
    for entry in left:
        found = _OWN.fullmatch(entry.name)
        if found is None or found["host"] != _host() or _is_alive(int(found["process"])):
            continue
        path = Path(entry.path)
        # Others may write to this folder, and their files must not make us move or remove anything.
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            information = entry.stat(follow_symlinks=False)
            if information.st_uid != os.geteuid() or stat.S_ISLNK(information.st_mode):
                continue
            if not stat.S_ISDIR(information.st_mode):
                path.unlink(missing_ok=True)
            elif entry.name.endswith(READY):
                _finish_ready(path)
            else:
                shutil.rmtree(path, ignore_errors=True)


def partial_path(path: Path) -> Path:
    """Return a hidden name next to `path` that no other writer uses. It contains only the start of the original
    name, because that may already have the largest possible length.
    """
    return path.with_name(f".{path.name[:NAME_CHARACTERS]}.{_host()}-{os.getpid()}-{os.urandom(4).hex()}{PARTIAL}")


@contextmanager
def write_errors(path: Path) -> Iterator[None]:
    """Turn errors of the operating system into one line that names `path`."""
    try:
        yield
    except OSError as error:
        raise unreadable(error, path, "check the folder and the free space", doing="written") from error


def is_full(folder: Path) -> bool:
    """Return whether the disk of a folder is full: libraries do not tell why they could not write."""
    probe = partial_path(folder / "probe")
    try:
        with probe.open("wb", buffering=0) as file:
            file.write(bytes(PROBE_BYTES))
            os.fsync(file.fileno())
            return file.tell() < PROBE_BYTES
    except OSError as error:
        return error.errno in (errno.ENOSPC, errno.EDQUOT)
    finally:
        probe.unlink(missing_ok=True)


def write_failure(path: Path, partial: Path, said: str) -> InputError:
    """Return the error about an output that a library could not write, without giving the reason.

    Parameters
    ----------
    path : pathlib.Path
        The output.
    partial : pathlib.Path
        The file, or the folder of files, that the library wrote.
    said : str
        The library's message, used if neither the limit of file sizes nor a full disk is the reason.
    """
    files = [one for one in (partial, *partial.rglob("*")) if one.is_file()]
    number = errno.ENOSPC if is_full(path.parent) else 0
    if max((one.stat().st_size for one in files), default=0) >= largest_file():
        number = errno.EFBIG
    reason = OSError(number, os.strerror(number)) if number else RuntimeError(said)
    return unreadable(reason, path, "check the folder and the free space", doing="written")


def largest_file() -> float:
    """Return the limit of this process for the size of a file (``ulimit -f``) [bytes]; infinite if there is none."""
    try:
        import resource
    except ImportError:  # Windows has no such limit.
        return math.inf
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return math.inf if limit == resource.RLIM_INFINITY else limit


def _finish_ready(ready: Path) -> None:
    # A process that was killed while it removed the folder had already moved all files: then there is no manifest, or
    # it is removed now.
    if (ready / MANIFEST).exists():
        _move_out(ready)
    shutil.rmtree(ready, ignore_errors=True)


def _move_out(ready: Path) -> None:
    """Move and remove files according to the manifest of a folder."""
    manifest: Mapping[str, list[str]] = json.loads((ready / MANIFEST).read_text(encoding="utf-8"))
    for name in (*manifest["move"], *manifest["remove"]):
        if Path(name).name != name or name == MANIFEST:
            raise ValueError(f"{name!r} is not a valid name for a file here")
    for name in manifest["move"]:
        # A file that is no longer there was moved before the process was killed.
        if (ready / name).exists():
            _replace(ready / name, ready.parent / name)
    for name in manifest["remove"]:
        (ready.parent / name).unlink(missing_ok=True)


def move_into(partial: Path, path: Path, *, overwrite: bool, through_links: bool = True) -> None:
    """Move a file to its final path; InputError if a file is there that may not be replaced."""
    if overwrite:
        if not through_links and path.is_symlink():
            os.replace(partial, path)
        else:
            _replace(partial, path)
        return
    try:
        # Making a link fails if the path exists, even if another process created it just now.
        os.link(partial, path)
    except FileExistsError as error:
        raise output_exists(path) from error
    except OSError:
        # Some file systems have no links: an empty file reserves the name.
        try:
            path.open("xb").close()
        except FileExistsError as error:
            raise output_exists(path) from error
        os.replace(partial, path)


def _replace(new: Path, path: Path) -> None:
    """Put a file in the place of another, through links, keeping the mode of the replaced file."""
    place = _link_target(path)
    with contextlib.suppress(FileNotFoundError):
        os.chmod(new, stat.S_IMODE(place.stat().st_mode))
    if place.parent == path.parent or new.stat().st_dev == place.parent.stat().st_dev:
        os.replace(new, place)
    else:
        place = partial_path(place)
        shutil.copy2(new, place)
        os.replace(place, place)
        new.unlink()


def _link_target(path: Path) -> Path:
    """Return the target of a link; any other path as it is."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def output_exists(path: str | Path) -> InputError:
    """Return the error about an output path that already exists."""
    return InputError("exists already", code="output-exists", path=path, setting="overwrite", purpose="to replace it")


def _check_folder(folder: Path) -> None:
    if not folder.is_dir():
        raise InputError("this folder does not exist; make it first", code="file-missing", path=folder)


def _host() -> str:
    return hashlib.sha256(platform.node().encode()).hexdigest()[:8]


def _is_alive(process: int) -> bool:
    if os.name == "nt":
        # Windows has no signal 0 to test whether a process exists.
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    # A killed process stays listed until its parent collects it, which in a container may be never.
    with contextlib.suppress(OSError):
        known = Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace")
        return not known.rpartition(") ")[2].startswith("Z")
    return True


KEEP_SIZE = 1
"""Linux' FALLOC_FL_KEEP_SIZE: allocate beyond the end of a file without changing its size."""

RESERVE_MARGIN = 2**20
"""Bytes that are reserved in addition to those requested."""


class ReservedRoom:
    """Disk space reserved for a file that other code writes, because that code cannot report a full disk.

    On a file system that cannot reserve space, only the free space is checked. Unused space is given back when the
    file's length changes for the last time, or when it is moved; it never counts as part of the file's size.

    Parameters
    ----------
    path : pathlib.Path
        Path of the file, which exists.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._wanted = path, 0

    def reserve(self, more: int) -> None:
        """Reserve space for `more` further bytes; OSError if there is none, or if files may not become so large."""
        self._wanted += more
        if self._wanted + RESERVE_MARGIN > largest_file():
            raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(self._path))
        with self._path.open("r+b", buffering=0) as file:
            failure = _allocate(file.fileno(), self._wanted + RESERVE_MARGIN)
        if failure in (errno.ENOSPC, errno.EDQUOT):
            raise OSError(failure, os.strerror(failure), str(self._path))
        left = self._wanted + RESERVE_MARGIN - self._path.stat().st_size
        if failure and shutil.disk_usage(self._path.parent).free < left:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._path))

    def release(self) -> None:
        """Give back the space that the file did not need."""
        size = self._path.stat().st_size
        # On some file systems, setting an unchanged length frees nothing.
        for length in (size + 1, size):
            os.truncate(self._path, length)


def _allocate(file: int, length: int) -> int:
    """Allocate the first bytes of a file; return an error number, or 0."""
    try:
        allocate = ctypes.CDLL(None, use_errno=True).fallocate64
    except (AttributeError, OSError, TypeError):
        return errno.ENOTSUP
    allocate.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_int64, ctypes.c_int64)
    return ctypes.get_errno() if allocate(file, KEEP_SIZE, 0, length) else 0
