"""Work on many items in shares, several at once: the compiled loops let other threads run.

Each share writes what no other one reads, so that no result depends on the number of threads.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, TypeVar, cast

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor

Result = TypeVar("Result")
Other = TypeVar("Other")

SHARES_A_THREAD = 4
"""Shares are alike in size, not in work: who is done with one takes the next."""

LEAST_SHARED = 6000
"""Vertices times frames of a clip from which on several threads are done sooner than one alone, by measurement: below,
they mostly wait for each other."""

_is_alone: ContextVar[bool] = ContextVar("is_alone", default=False)


@contextmanager
def threads_for(size: int) -> Iterator[None]:
    """One thread works alone in this block where `size`, vertices times frames, is small and nobody asked for more."""
    before = _is_alone.set(size < LEAST_SHARED and _asked_threads() is None)
    try:
        yield
    finally:
        _is_alone.reset(before)


def _asked_threads() -> int | None:
    asked = os.environ.get("PDECODEC_THREADS", "")
    return int(asked) if asked.isdecimal() and int(asked) > 0 else None


def thread_count() -> int:
    """Threads that work at once: as many as the environment's PDECODEC_THREADS says, else one a processor, or one."""
    if _is_alone.get():
        return 1
    asked = _asked_threads()
    if asked is not None:
        return asked
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@lru_cache
def _helpers(count: int) -> ThreadPoolExecutor:
    """Threads that wait for work: starting one takes longer than many a share."""
    from concurrent.futures import ThreadPoolExecutor  # who only decodes has no use for it

    return ThreadPoolExecutor(count)


if hasattr(os, "register_at_fork"):
    # A process that was forked off has none of its parent's threads.
    os.register_at_fork(after_in_child=_helpers.cache_clear)


def side_by_side(*works: Callable[[], Result]) -> list[Result]:
    """What several calls return, made at once as far as there are threads; they must not depend on each other."""
    found: dict[int, Result] = {}

    def call(first: int, end: int) -> None:
        for index in range(first, end):
            found[index] = works[index]()

    in_shares(call, len(works))
    return [found[index] for index in range(len(works))]


def both(one: Callable[[], Result], other: Callable[[], Other]) -> tuple[Result, Other]:
    """What two calls return, made at once where there is a thread for it."""
    found = side_by_side(one, other)
    return cast(Result, found[0]), cast(Other, found[1])


def in_shares(work: Callable[[int, int], None], count: int) -> None:
    """Call ``work(first, end)`` for runs of the items 0 to `count` - 1 that cover each once.

    Parameters
    ----------
    work : callable
        Called from several threads at once, this one among them; it may have shares of its own.
    count : int
        No call where it is 0.
    """
    threads = min(thread_count(), count)
    shares = min(SHARES_A_THREAD * threads, count) if threads > 1 else min(count, 1)
    cuts = [count * k // max(shares, 1) for k in range(shares + 1)]
    left, works = deque(pairwise(cuts)), [work]

    def take() -> None:
        while left:
            try:
                share = left.popleft()
            except IndexError:  # another thread took the last one
                return
            works[0](*share)

    if threads < 2:
        take()
        return
    from concurrent.futures import wait

    others = [_helpers(threads - 1).submit(take) for _ in range(threads - 1)]
    try:
        take()
    finally:
        left.clear()
        # Helpers that are busy elsewhere have not begun; there is nothing left for them here.
        begun = [other for other in others if not other.cancel()]
        wait(begun)
        # A helper keeps what was cancelled until it has time to throw it away: not with the arrays that the work holds.
        works.clear()
    for other in begun:
        other.result()
