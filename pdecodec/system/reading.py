"""Open files for reading: only regular ones, and of the files that a file names only those near it.

A pipe could block its reader and a device fill the memory. A file from a stranger could name any other file, whose
content would come back as positions. :func:`open_regular` opens files that a caller names, a :class:`FileScope`
files that another file names.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import BinaryIO

from pdecodec.errors import InputError, SettingsError, damaged, unreadable
from pdecodec.system.arguments import as_path, shown
from pdecodec.system.storage import RemoteFile

FOLDERS_VARIABLE = "PDECODEC_ASSET_FOLDERS"
"""Environment variable with more folders in which files may name others, in the syntax of PATH."""

LONGEST_SHOWN = 200
"""Largest number of characters of a file name in an error message."""

_KINDS = {stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device"}

_allowed: ContextVar[tuple[str, ...]] = ContextVar("folders in which files may name others", default=())


@contextmanager
def asset_folders_allowed(folders: Iterable[str | os.PathLike[str]]) -> Iterator[None]:
    """Also allow files opened in this block to name files in and below these folders."""
    listed = [folders] if isinstance(folders, str | bytes | os.PathLike) else folders
    if not isinstance(listed, Iterable):
        raise SettingsError(f"must be a list of folders, not {shown(folders)}", setting="asset_folders")
    paths = [as_path(folder, "asset_folders") for folder in listed]
    try:
        token = _allowed.set((*_allowed.get(), *map(os.path.realpath, paths)))
    except ValueError as error:
        raise SettingsError("must be valid folder names", setting="asset_folders") from error
    try:
        yield
    finally:
        _allowed.reset(token)


def allowed_folders() -> tuple[str, ...]:
    """Return the folders of :func:`asset_folders_allowed`, without those of the environment."""
    return _allowed.get()


def open_regular(path: str | os.PathLike[str], *, is_buffered: bool = True) -> BinaryIO:
    """Open a regular file for reading, without waiting for a process that writes to it.

    Raises
    ------
    OSError
        If it cannot be opened, or is a folder.
    InputError
        If it is a pipe, a socket or a device, or no file can have its name.
    """
    path = as_path(path)
    try:
        _check_mode(path, os.stat(path).st_mode)  # Check before opening, because a device may react to that.
        return open(path, "rb", -1 if is_buffered else 0, opener=_opened)
    except ValueError as error:  # The path has a NUL, or half a surrogate pair.
        raise unreadable(error, path, "check the name", doing="opened") from error


def read_regular(path: Path, most: int | None = None) -> bytes:
    """Return the bytes of a regular file, at most `most` from its beginning; raises the errors of
    :func:`open_regular`.
    """
    with open_regular(path) as file:
        return file.read() if most is None else read_at_most(file, most)


def read_at_most(file: BinaryIO, most: int) -> bytes:
    """Return the next bytes of a regular file, at most `most`; allocates memory only for existing bytes."""
    return file.read(max(0, min(most, os.fstat(file.fileno()).st_size - file.tell())))


def _opened(path: str, flags: int) -> int:
    number = os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
    try:
        _check_mode(path, os.fstat(number).st_mode)
    except BaseException:
        os.close(number)
        raise
    return number


def _check_mode(path: str | os.PathLike[str], mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
    if not stat.S_ISREG(mode):
        kind = _KINDS.get(stat.S_IFMT(mode), "a special file")
        raise InputError(f"is {kind}, but only regular files can be read; copy it to one", code="unreadable", path=path)


class FileScope:
    """The files that a file may name: those in its folder and below, and in additional allowed folders.

    A link counts as the file it leads to. The folders of :func:`asset_folders_allowed` and of the environment are
    read when the scope is made, because files may be opened later.

    Parameters
    ----------
    path : pathlib.Path or RemoteFile
        The file that a caller opened; errors about the files it names refer to it.
    folders : iterable of str
        Additional allowed folders.
    """

    def __init__(self, path: Path | RemoteFile, folders: Iterable[str] = ()) -> None:
        self.path = path
        own = (os.path.dirname(os.path.abspath(path)), os.path.dirname(os.path.realpath(path)))
        listed = os.environ.get(FOLDERS_VARIABLE, "").split(os.pathsep)
        named = (*(own if isinstance(path, Path) else ()), *folders, *(one for one in listed if one))
        self._folders = (*map(os.path.realpath, named), *_allowed.get())

    def checked(self, name: str, folder: Path | None = None) -> Path:
        """Return the path of a file if it lies inside; it need not exist.

        Parameters
        ----------
        name : str
            The name in the file.
        folder : pathlib.Path, optional
            Folder that the name is relative to. Default: the folder of :attr:`path`.

        Raises
        ------
        InputError
            If it lies elsewhere, or no file can have the name.
        """
        place = os.path.join(os.path.dirname(self.path) if folder is None else folder, name)
        try:
            real = os.path.realpath(place)
        except ValueError as error:
            raise damaged(
                f"names a file {_shown(name)}, which is not a valid name; export it again", path=self.path
            ) from error
        if not any(_is_below(real, allowed) for allowed in self._folders):
            raise InputError(
                f"names {_shown(name)}, which lies outside its folder and is not read",
                code="outside-folder",
                path=self.path,
                setting="asset_folders",
                value=os.path.dirname(real)[:LONGEST_SHOWN],
                purpose="if you trust the file",
            )
        return Path(place)

    def regular(self, name: str, folder: Path | None = None) -> Path:
        """Return the path of a regular file that lies inside, for a library to open; raises the errors of
        :meth:`open`.
        """
        with self.open(name, folder) as file:
            return Path(file.name)

    def open(self, name: str, folder: Path | None = None) -> BinaryIO:
        """Open a regular file that lies inside.

        Raises
        ------
        InputError
            If it lies elsewhere, is missing, cannot be read, or is no regular file.
        """
        path = self.checked(name, folder)
        try:
            return open_regular(path)
        except FileNotFoundError as error:
            message = f"names {_shown(name)}, which is missing; restore that file"
            raise InputError(message, code="file-missing", path=self.path) from error
        except OSError as error:
            message = f"names {_shown(name)}, which cannot be read ({error.strerror})"
            raise InputError(message, code="unreadable", path=self.path) from error

    def read(self, name: str, most: int | None = None, folder: Path | None = None) -> bytes:
        """Return the bytes of a file, at most `most` from its beginning; raises the errors of :meth:`open`."""
        with self.open(name, folder) as file:
            return file.read() if most is None else read_at_most(file, most)


def _shown(name: str) -> str:
    return repr(name if len(name) <= LONGEST_SHOWN else f"{name[:LONGEST_SHOWN]}...")


def _is_below(path: str, folder: str) -> bool:
    try:
        return os.path.commonpath((path, folder)) == os.path.normpath(folder)
    except ValueError:  # The file is on another drive.
        return False
