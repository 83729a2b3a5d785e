"""Divide work into shares that run in parallel threads: the compiled loops release the interpreter lock.

No share writes data that another share reads, so no result depends on the number of threads.
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

SHARES_PER_THREAD = 4
"""Number of shares per thread. Shares are equal in size, not in work, so a thread that is done takes the next share."""

MIN_SHARED_SIZE = 6000
"""Smallest size of a clip, in vertices times frames, at which several threads are faster than one, as measured;
for smaller clips threads mostly wait for each other.
"""

_is_alone: ContextVar[bool] = ContextVar("is_alone", default=False)


@contextmanager
def threads_for(size: int) -> Iterator[None]:
    """Use one thread in this block if `size`, vertices times frames, is small and the environment does not
    request more.
    """
    before = _is_alone.set(size < MIN_SHARED_SIZE and _asked_threads() is None)
    try:
        yield
    finally:
        _is_alone.reset(before)


def _asked_threads() -> int | None:
    asked = os.environ.get("PDECODEC_THREADS", "")
    return int(asked) if asked.isdecimal() and int(asked) > 0 else None


def thread_count() -> int:
    """Return the number of threads to use: PDECODEC_THREADS of the environment if set, else one per processor."""
    if _is_alone.get():
        return 1
    asked = _asked_threads()
    if asked is not None:
        return asked
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@lru_cache
def _helpers(count: int) -> ThreadPoolExecutor:
    """Return a pool of waiting threads, because starting a thread takes longer than many shares."""
    from concurrent.futures import ThreadPoolExecutor  # Imported here because decoding alone never needs it.

    return ThreadPoolExecutor(count)


if hasattr(os, "register_at_fork"):
    # A forked process has none of its parent's threads.
    os.register_at_fork(after_in_child=_helpers.cache_clear)


def side_by_side(*works: Callable[[], Result]) -> list[Result]:
    """Return the results of several independent calls, made in parallel as far as there are threads."""
    found: dict[int, Result] = {}

    def call(first: int, end: int) -> None:
        for index in range(first, end):
            found[index] = works[index]()

    in_shares(call, len(works))
    return [found[index] for index in range(len(works))]


def both(one: Callable[[], Result], other: Callable[[], Other]) -> tuple[Result, Other]:
    """Return the results of two independent calls, made in parallel if there are threads."""
    found = side_by_side(one, other)
    return cast(Result, found[0]), cast(Other, found[1])


def in_shares(work: Callable[[int, int], None], count: int) -> None:
    """Call ``work(first, end)`` for consecutive ranges of the items 0 to `count` - 1 that cover each item once.

    Parameters
    ----------
    work : callable
        Called from several threads at once, including this one; it may divide its own work into shares.
    count : int
        Number of items; no call if it is 0.
    """
    threads = min(thread_count(), count)
    shares = min(SHARES_PER_THREAD * threads, count) if threads > 1 else min(count, 1)
    cuts = [count * k // max(shares, 1) for k in range(shares + 1)]
    left, works = deque(pairwise(cuts)), [work]

    def take() -> None:
        while left:
            try:
                share = left.popleft()
            except IndexError:  # Another thread took the last share.
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
        # Helpers that are busy elsewhere have not begun, and there is no work left for them here.
        begun = [other for other in others if not other.cancel()]
        wait(begun)
        # A helper keeps a cancelled call until it finds time to drop it: do not let it keep the arrays of `work`.
        works.clear()
    for other in begun:
        other.result()
