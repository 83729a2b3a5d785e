"""Linear algebra in one thread while a clip is encoded.

The products are small and many: BLAS' own threads spend their time waiting for each other, five times as much of it
where another program runs, and how they share a sum out decides its last bits. The encoder shares out whole steps
instead (:mod:`pdecodec.shares`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Within, BLAS of this process takes one thread; afterwards as many as before."""
    with _controller().limit(limits=1, user_api="blas"):
        yield


@cache
def _controller() -> Any:
    """What knows the libraries of linear algebra that are loaded: numpy's is, since arrays are there."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
