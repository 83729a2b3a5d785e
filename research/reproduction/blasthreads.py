"""Limit numpy's linear algebra to one thread while the paper's method is measured.

The products are small and many. With several threads, BLAS spends its time waiting, five times as much when another
program runs, and the way it divides a sum decides the last bits. (The encoder uses no BLAS.)
"""

from __future__ import annotations

import ctypes
import importlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

_MODULES = ("numpy.linalg._umath_linalg",)
"""Modules that are linked with numpy's BLAS."""

_CALLS = (
    *(
        (f"{prefix}openblas_get_num_threads{suffix}", f"{prefix}openblas_set_num_threads{suffix}")
        for prefix in ("scipy_", "")
        for suffix in ("", "64_", "_64")
    ),
    ("MKL_Get_Max_Threads", "MKL_Set_Num_Threads"),
    ("bli_thread_get_num_threads", "bli_thread_set_num_threads"),
)
"""Functions of OpenBLAS (as numpy and scipy ship it, and as systems do), of MKL and of BLIS."""


class _Library(NamedTuple):
    """Functions of a library that get and set its number of threads."""

    count: Any
    limit: Any


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit this process's BLAS to one thread within the context; restore the number afterwards."""
    before = blas_threads()
    for library in _libraries():
        library.limit(1)
    try:
        yield
    finally:
        for library, threads in zip(_libraries(), before, strict=True):
            library.limit(threads)


def blas_threads() -> list[int]:
    """Return the thread counts of numpy's BLAS; empty if this BLAS is not in :data:`_CALLS`."""
    return [int(library.count()) for library in _libraries()]


@cache
def _libraries() -> tuple[_Library, ...]:
    found = []
    for name in _MODULES:
        with suppress(ImportError, OSError):
            file = Path(str(importlib.import_module(name).__file__))
            # Except on Windows, the functions of linked libraries are found through the module.
            libraries = (file.parents[2] / f"{name.split('.')[0]}.libs").glob("*openblas*")
            loaded = [ctypes.CDLL(str(path)) for path in (file, *libraries)]
            known = (_named(library, *calls) for library in loaded for calls in _CALLS)
            found.append(next(filter(None, known), None))
    return tuple(library for library in found if library is not None)


def _named(library: ctypes.CDLL, count: str, limit: str) -> _Library | None:
    """Return two functions of a library by name; None if it lacks them."""
    try:
        return _Library(getattr(library, count), getattr(library, limit))
    except AttributeError:
        return None
