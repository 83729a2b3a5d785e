"""Work on many items in shares, several at once: the compiled loops let other threads run.

Each share writes what no other one reads, so that no result depends on the number of threads.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import lru_cache
from itertools import pairwise
from typing import TypeVar

Result = TypeVar("Result")

SHARES_A_THREAD = 4
"""Shares are alike in size, not in work: who is done with one takes the next."""


def thread_count() -> int:
    """Threads that work at once: one a processor, or as many as the environment's PDECODEC_THREADS says."""
    asked = os.environ.get("PDECODEC_THREADS", "")
    if asked.isdecimal() and int(asked) > 0:
        return int(asked)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@lru_cache
def _helpers(count: int) -> ThreadPoolExecutor:
    """Threads that wait for work: starting one takes longer than many a share."""
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
