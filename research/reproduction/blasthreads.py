"""Numpy's linear algebra in one thread while the paper's method is measured.

The products are small and many: BLAS' own threads spend their time waiting for each other, five times as much of it
where another program runs, and how they share a sum out decides its last bits. (The encoder has no BLAS in it.)
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
"""What is linked with the BLAS that numpy uses."""

_CALLS = (
    *(
        (f"{prefix}openblas_get_num_threads{suffix}", f"{prefix}openblas_set_num_threads{suffix}")
        for prefix in ("scipy_", "")
        for suffix in ("", "64_", "_64")
    ),
    ("MKL_Get_Max_Threads", "MKL_Set_Num_Threads"),
    ("bli_thread_get_num_threads", "bli_thread_set_num_threads"),
)
"""Functions of OpenBLAS (as numpy and scipy bring it along, and as systems do), of MKL and of BLIS."""


class _Library(NamedTuple):
    """Functions of a library: how many threads it takes, and to have it take so many."""

    count: Any
    limit: Any


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Within, BLAS of this process takes one thread; afterwards as many as before."""
    before = blas_threads()
    for library in _libraries():
        library.limit(1)
    try:
        yield
    finally:
        for library, threads in zip(_libraries(), before, strict=True):
            library.limit(threads)


def blas_threads() -> list[int]:
    """How many threads numpy's BLAS takes; nothing where it is none of :data:`_CALLS`."""
    return [int(library.count()) for library in _libraries()]


@cache
def _libraries() -> tuple[_Library, ...]:
    found = []
    for name in _MODULES:
        with suppress(ImportError, OSError):
            file = Path(str(importlib.import_module(name).__file__))
            # Functions of the libraries that a module is linked with are found through it, but on Windows.
            beside = (file.parents[2] / f"{name.split('.')[0]}.libs").glob("*openblas*")
            loaded = [ctypes.CDLL(str(path)) for path in (file, *beside)]
            known = (_named(library, *calls) for library in loaded for calls in _CALLS)
            found.append(next(filter(None, known), None))
    return tuple(library for library in found if library is not None)


def _named(library: ctypes.CDLL, count: str, limit: str) -> _Library | None:
    """Two functions of a library by their names; None if it has no such."""
    try:
        return _Library(getattr(library, count), getattr(library, limit))
    except AttributeError:
        return None
