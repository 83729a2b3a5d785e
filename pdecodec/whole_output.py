"""Outputs that appear whole or not at all: written beside their place, then renamed into it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pdecodec.errors import InputError


def check_writable(path: Path, *, overwrite: bool) -> None:
    """Raise InputError if `path` cannot become an output file; worth calling before long work starts."""
    if path.is_dir():
        raise InputError("is a folder; name a file in it", path=path)
    if path.exists() and not overwrite:
        raise InputError("exists already; choose another name, or overwrite it (--overwrite)", path=path)
    _check_folder(path.parent)
    if not os.access(path.parent, os.W_OK):
        raise InputError("this folder is not writable; choose another, or change its permissions", path=path.parent)


@contextmanager
def whole_file(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """A path to write to that becomes `path` when the block ends well and vanishes when it does not.

    Raises
    ------
    InputError
        If `path` exists and `overwrite` is false, is a folder, or cannot be written.
    """
    check_writable(path, overwrite=overwrite)
    partial = partial_path(path)
    try:
        with write_errors(path):
            yield partial
            os.replace(partial, path)
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
    partial = partial_path(beside)
    with write_errors(beside):
        partial.mkdir()
    try:
        yield partial
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def partial_path(path: Path) -> Path:
    """A hidden name beside `path` that no other writer takes."""
    return path.with_name(f".{path.name}.{os.urandom(6).hex()}.partial")


@contextmanager
def write_errors(path: Path) -> Iterator[None]:
    """Turn the operating system's refusals into one line that names `path`."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"cannot be written ({reason}); check the folder and the free space", path=path) from error


def _check_folder(folder: Path) -> None:
    if not folder.is_dir():
        raise InputError("this folder does not exist; make it first", path=folder)
