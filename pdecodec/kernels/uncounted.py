"""Decorators of compiled functions that do not count references to their arrays, and let other threads run.

numba counts references at every call of one compiled function by another, which takes ten times as long as coding a
bit. These functions make no arrays, so there is nothing to count. ``_nrt`` is numba's name for the counting; its
types do not know it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

_njit: Any = numba.njit


def uncounted(function: Function) -> Function:
    """Compile; arrays may be passed, sliced and changed, and not made."""
    compiled: Function = _njit(cache=True, nogil=True, _nrt=False)(function)
    return compiled


def uncounted_inline(function: Function) -> Function:
    """As :func:`uncounted`, and part of each function that calls it."""
    compiled: Function = _njit(cache=True, forceinline=True, nogil=True, _nrt=False)(function)
    return compiled
