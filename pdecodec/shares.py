"""Work on many items in shares, several at once: the compiled loops let other threads run.

Each share writes what no other one reads, so that no result depends on the number of threads.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
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


def side_by_side(*works: Callable[[], Result]) -> list[Result]:
    """What several calls return, made at once as far as there are threads; they must not depend on each other."""
    threads = min(thread_count(), len(works))
    if threads < 2:
        return [work() for work in works]
    with ThreadPoolExecutor(threads) as pool:
        return [future.result() for future in [pool.submit(work) for work in works]]


def in_shares(work: Callable[[int, int], None], count: int) -> None:
    """Call ``work(first, end)`` for runs of the items 0 to `count` - 1 that cover each once.

    Parameters
    ----------
    work : callable
        Called from several threads at once.
    count : int
        No call where it is 0.
    """
    threads = min(thread_count(), count)
    shares = min(SHARES_A_THREAD * threads, count) if threads > 1 else min(count, 1)
    cuts = [count * k // max(shares, 1) for k in range(shares + 1)]
    left = deque(pairwise(cuts))

    def take() -> None:
        while left:
            try:
                share = left.popleft()
            except IndexError:  # another thread took the last one
                return
            work(*share)

    if threads < 2:
        take()
        return
    with ThreadPoolExecutor(threads - 1) as pool:
        others = [pool.submit(take) for _ in range(threads - 1)]
        take()
        for other in others:
            other.result()
