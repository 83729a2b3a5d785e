"""Outputs that appear whole or not at all: written beside their place, then moved into it.

What is written stands in a hidden file or folder whose name says which process makes it. Several files, such as frames,
become visible together: their folder is renamed to one that is ready, and its files are moved. A run that is killed
leaves what it was writing, or what was ready: the next run that reads or writes there removes the one and finishes the
other.
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
"""Ends of names: of what is being written, and of what is whole and has to be moved."""

MANIFEST = ".manifest.json"
"""In a folder that is ready: the names of files that its own replace, and of those that go."""

TOLD = 24
"""Letters of an output's name that are in that of what is being written: with four bytes each, and all that follows, a
name is below 143 bytes, the least that a file system in use allows (eCryptfs)."""

PROBE_BYTES = 2**16
"""What is written to learn whether a disk is full."""

_OWN = re.compile(r"\..+\.(?P<host>[0-9a-f]{8})-(?P<process>\d+)-[0-9a-f]{8}(\.partial|\.ready)", re.DOTALL)


def check_path(path: Path) -> None:
    """Raise InputError if no file can have this path."""
    try:
        os.lstat(path)
    except ValueError as error:
        raise InputError(
            "holds a character that no path can have (NUL, or half of a pair); give another name",
            code="output-unwritable",
            path=path,
        ) from error
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise InputError(
                "is longer than names may be there; give a shorter one", code="output-unwritable", path=path
            ) from error


def check_writable(path: Path, *, overwrite: bool, through_links: bool = True) -> None:
    """Raise InputError if `path` cannot become an output file; worth calling before long work starts."""
    check_path(path)
    if path.is_dir() and (through_links or not path.is_symlink()):
        raise InputError("is a folder; name a file in it", code="output-unwritable", path=path)
    if os.path.lexists(path) and not overwrite:
        raise output_exists(path)
    place = (_place(path) if through_links else path).parent
    _check_folder(place)
    if not os.access(place, os.W_OK):
        raise InputError(
            "this folder is not writable; choose another, or change its permissions",
            code="output-unwritable",
            path=place,
        )


@contextmanager
def whole_file(path: Path, *, overwrite: bool, through_links: bool = True) -> Iterator[Path]:
    """A path to write to that becomes `path` when the block ends well and vanishes when it does not.

    A link is written through, unless `through_links` is false: then it is replaced. A file that is replaced keeps its
    mode.

    Raises
    ------
    InputError
        If `path` exists, or appears meanwhile, and `overwrite` is false, is a folder, or cannot be written.
    """
    check_writable(path, overwrite=overwrite, through_links=through_links)
    place = _place(path) if through_links else path
    finish_interrupted(place.parent)
    partial = partial_path(place)
    try:
        with write_errors(path):
            yield partial
            move_into(partial, path, overwrite=overwrite, through_links=through_links)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def partial_folder(beside: Path) -> Iterator[Path]:
    """A new empty folder beside `beside`, gone after the block unless it was renamed.

    Raises
    ------
    InputError
        If it cannot be made.
    """
    _check_folder(beside.parent)
    finish_interrupted(beside.parent)
    partial = partial_path(beside)
    with write_errors(beside):
        partial.mkdir()
    try:
        yield partial
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def publish(partial: Path, names: Sequence[str], *, overwrite: bool, remove: Sequence[str] = ()) -> None:
    """Move files of a partial folder to the folder it is in, all of them, whatever happens in between.

    Parameters
    ----------
    partial : pathlib.Path
    names : sequence of str
        Of files in it; those that are there already are replaced, if `overwrite` says so.
    overwrite : bool
    remove : sequence of str
        Of files beside it that go.

    Raises
    ------
    InputError
        If a file is there, and may not be replaced; nothing is moved then.
    """
    folder = partial.parent
    taken = [] if overwrite else [name for name in names if os.path.lexists(folder / name)]
    if taken:
        raise output_exists(folder / taken[0])
    (partial / MANIFEST).write_text(json.dumps({"move": list(names), "remove": list(remove)}), encoding="utf-8")
    ready = partial.with_name(partial.name.removesuffix(PARTIAL) + READY)
    os.replace(partial, ready)
    _finish(ready)


def finish_interrupted(folder: Path) -> None:
    """Finish or remove what killed runs of this machine and user left in a folder."""
    try:
        left = [entry for entry in os.scandir(folder) if entry.name.startswith(".")]
    except OSError:
        return
    for entry in left:
        found = _OWN.fullmatch(entry.name)
        if found is None or found["host"] != _host() or _is_alive(int(found["process"])):
            continue
        path = Path(entry.path)
        # Others may write here: what is not ours moves and removes nothing.
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            information = entry.stat(follow_symlinks=False)
            if information.st_uid != os.geteuid() or stat.S_ISLNK(information.st_mode):
                continue
            if not stat.S_ISDIR(information.st_mode):
                path.unlink(missing_ok=True)
            elif entry.name.endswith(READY):
                _finish(path)
            else:
                shutil.rmtree(path, ignore_errors=True)


def partial_path(path: Path) -> Path:
    """A hidden name beside `path` that no other writer takes; it tells the beginning of the name alone, which may be as
    long as names can be.
    """
    return path.with_name(f".{path.name[:TOLD]}.{_host()}-{os.getpid()}-{os.urandom(4).hex()}{PARTIAL}")


@contextmanager
def write_errors(path: Path) -> Iterator[None]:
    """Turn the operating system's refusals into one line that names `path`."""
    try:
        yield
    except OSError as error:
        raise unreadable(error, path, "check the folder and the free space", doing="written") from error


def is_full(folder: Path) -> bool:
    """Whether there is no space left where a folder is: libraries do not say why they could not write."""
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
    """Return the error about an output that a library could not write, which does not say why.

    Parameters
    ----------
    path : pathlib.Path
        The output.
    partial : pathlib.Path
        The file, or the folder of files, that the library wrote.
    said : str
        What it said, where neither the limit of file sizes nor a full disk is the reason.
    """
    files = [one for one in (partial, *partial.rglob("*")) if one.is_file()]
    number = errno.ENOSPC if is_full(path.parent) else 0
    if max((one.stat().st_size for one in files), default=0) >= largest_file():
        number = errno.EFBIG
    reason = OSError(number, os.strerror(number)) if number else RuntimeError(said)
    return unreadable(reason, path, "check the folder and the free space", doing="written")


def largest_file() -> float:
    """Bytes that a file may have by the limit of this process (``ulimit -f``); infinite where there is none."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return math.inf
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return math.inf if limit == resource.RLIM_INFINITY else limit


def _finish(ready: Path) -> None:
    # What was killed while it removed the folder had moved everything before: the manifest went then, or is going now.
    if (ready / MANIFEST).exists():
        _move_out(ready)
    shutil.rmtree(ready, ignore_errors=True)


def _move_out(ready: Path) -> None:
    """Do what the manifest of a folder says."""
    manifest: Mapping[str, list[str]] = json.loads((ready / MANIFEST).read_text(encoding="utf-8"))
    for name in (*manifest["move"], *manifest["remove"]):
        if Path(name).name != name or name == MANIFEST:
            raise ValueError(f"{name!r} is no name of a file here")
    for name in manifest["move"]:
        # What is no longer there was moved before the run was killed.
        if (ready / name).exists():
            _replace(ready / name, ready.parent / name)
    for name in manifest["remove"]:
        (ready.parent / name).unlink(missing_ok=True)


def move_into(partial: Path, path: Path, *, overwrite: bool, through_links: bool = True) -> None:
    """Put a file where it is to be; InputError where there is one that may not be replaced."""
    if overwrite:
        if not through_links and path.is_symlink():
            os.replace(partial, path)
        else:
            _replace(partial, path)
        return
    try:
        # A link is made only where there is nothing, whoever was here meanwhile.
        os.link(partial, path)
    except FileExistsError as error:
        raise output_exists(path) from error
    except OSError:
        # Some file systems have no links: an empty file keeps the place.
        try:
            path.open("xb").close()
        except FileExistsError as error:
            raise output_exists(path) from error
        os.replace(partial, path)


def _replace(new: Path, path: Path) -> None:
    """Put a file in the place of another, through links, with its mode."""
    place = _place(path)
    with contextlib.suppress(FileNotFoundError):
        os.chmod(new, stat.S_IMODE(place.stat().st_mode))
    if place.parent == path.parent or new.stat().st_dev == place.parent.stat().st_dev:
        os.replace(new, place)
    else:
        beside = partial_path(place)
        shutil.copy2(new, beside)
        os.replace(beside, place)
        new.unlink()


def _place(path: Path) -> Path:
    """Where a path leads: of a link, what it is a link to."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def output_exists(path: str | Path) -> InputError:
    """Return the error about a place to write to that is taken."""
    return InputError("exists already", code="output-exists", path=path, setting="overwrite", purpose="to replace it")


def _check_folder(folder: Path) -> None:
    if not folder.is_dir():
        raise InputError("this folder does not exist; make it first", code="file-missing", path=folder)


def _host() -> str:
    return hashlib.sha256(platform.node().encode()).hexdigest()[:8]


def _is_alive(process: int) -> bool:
    if os.name == "nt":
        # A signal is no question there.
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    # One that was killed is there until whoever started it has looked, which in a container may be never.
    with contextlib.suppress(OSError):
        known = Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace")
        return not known.rpartition(") ")[2].startswith("Z")
    return True


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
        """Keep room for so many more bytes; OSError where there is none, or files may not become so large."""
        self._wanted += more
        if self._wanted + MARGIN > largest_file():
            raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(self._path))
        with self._path.open("r+b", buffering=0) as file:
            failure = _allocate(file.fileno(), self._wanted + MARGIN)
        if failure in (errno.ENOSPC, errno.EDQUOT):
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
