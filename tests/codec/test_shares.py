"""Shares of work: every item is done once, with any number of threads, and errors are raised; and the number of
threads.
"""

from __future__ import annotations

import os
import threading
import weakref
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest

from pdecodec.mesh.arrays import Float64Array
from pdecodec.system import shares


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, 7, 100])
def test_shares_cover_every_item_once(count: int, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", str(threads))
    seen = [0] * count

    def work(first: int, end: int) -> None:
        assert first < end
        for item in range(first, end):
            seen[item] += 1

    shares.in_shares(work, count)
    assert seen == [1] * count


@pytest.mark.parametrize("threads", [1, 3])
def test_an_error_in_a_share_comes_out(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", str(threads))

    def work(first: int, end: int) -> None:
        if first <= 42 < end:
            raise ValueError("item 42")

    with pytest.raises(ValueError, match="item 42"):
        shares.in_shares(work, 100)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_results_side_by_side_come_in_the_order_of_their_calls(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", str(threads))
    assert shares.side_by_side(*(partial(pow, k, 2) for k in range(9))) == [k * k for k in range(9)]
    assert shares.side_by_side() == []


def test_parallel_calls_run_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", "2")
    both = threading.Barrier(2, timeout=60)
    assert sorted(shares.side_by_side(both.wait, both.wait)) == [0, 1]


def test_shares_within_shares_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", "2")
    seen = []

    def inner(first: int, end: int) -> None:
        seen.extend(range(first, end))

    for _ in range(50):  # the single helper may or may not have begun
        shares.side_by_side(*(partial(shares.in_shares, inner, 10) for _ in range(4)))
    assert len(seen) == 50 * 4 * 10


def test_work_is_released_while_helpers_are_busy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", "2")
    is_done = threading.Event()

    def hold_array() -> bool:
        array = np.zeros(8)
        held = weakref.ref(array)

        def work(first: int, end: int, array: Float64Array = array) -> None:
            array[first:end] = 1.0

        shares.in_shares(work, 8)
        del array, work
        is_done.set()
        return held() is None

    assert shares.side_by_side(hold_array, lambda: is_done.wait(60.0)) == [True, True]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_process_that_was_forked_off_has_helpers_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", "2")
    both = threading.Barrier(2, timeout=20)
    shares.side_by_side(both.wait, both.wait)
    child = os.fork()
    if child == 0:  # no code of pytest may run in the child
        own = threading.Barrier(2, timeout=20)
        try:
            shares.side_by_side(own.wait, own.wait)
        except threading.BrokenBarrierError:
            os._exit(1)
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0


def test_both_of_two_calls_run_at_once_and_return_what_each_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", "2")
    meeting = threading.Barrier(2, timeout=60)
    found = shares.both(lambda: meeting.wait() >= 0 and "one", lambda: meeting.wait() >= 0 and 2)
    assert found == ("one", 2)


def test_a_small_clip_has_one_thread_in_its_own_thread_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PDECODEC_THREADS", raising=False)
    usual = shares.thread_count()
    with shares.threads_for(shares.MIN_SHARED_SIZE - 1):
        assert shares.thread_count() == 1
        with ThreadPoolExecutor(1) as other:
            assert other.submit(shares.thread_count).result() == usual
        with shares.threads_for(shares.MIN_SHARED_SIZE):
            assert shares.thread_count() == usual
        assert shares.thread_count() == 1
    assert shares.thread_count() == usual


def test_a_requested_number_of_threads_holds_for_small_clips_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", "3")
    with shares.threads_for(1):
        assert shares.thread_count() == 3


@pytest.mark.parametrize("asked", ["", "0", "-2", "many"])
def test_an_invalid_number_of_threads_is_ignored(monkeypatch: pytest.MonkeyPatch, asked: str) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", asked)
    assert 1 <= shares.thread_count() <= (os.cpu_count() or 1)
