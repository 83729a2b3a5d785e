"""How many threads work, and what calls beside each other return."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

from pdecodec.shares import LEAST_SHARED, both, in_shares, side_by_side, thread_count, threads_for


@pytest.fixture
def nobody_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PDECODEC_THREADS", raising=False)


@pytest.mark.usefixtures("nobody_asks")
def test_a_small_clip_has_one_thread_in_its_own_thread_alone() -> None:
    usual = thread_count()
    with threads_for(LEAST_SHARED - 1):
        assert thread_count() == 1
        with ThreadPoolExecutor(1) as other:
            assert other.submit(thread_count).result() == usual
        with threads_for(LEAST_SHARED):
            assert thread_count() == usual
        assert thread_count() == 1
    assert thread_count() == usual


def test_who_asks_for_threads_gets_them_for_a_small_clip_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", "3")
    with threads_for(1):
        assert thread_count() == 3


@pytest.mark.parametrize("asked", ["", "0", "-2", "many"])
def test_what_is_no_number_of_threads_asks_for_nothing(monkeypatch: pytest.MonkeyPatch, asked: str) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", asked)
    assert 1 <= thread_count() <= (os.cpu_count() or 1)


def test_two_calls_go_on_beside_each_other_and_return_what_each_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", "2")
    meeting = threading.Barrier(2, timeout=60)

    def met(value: str) -> Callable[[], str]:
        def call() -> str:
            meeting.wait()
            return value

        return call

    assert both(met("one"), met("other")) == ("one", "other")


@pytest.mark.parametrize("threads", ["1", "2", "5"])
def test_every_item_is_worked_on_once_and_results_keep_their_order(
    monkeypatch: pytest.MonkeyPatch, threads: str
) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", threads)
    for count in (0, 1, 2, 7, 100):
        shares: list[tuple[int, int]] = []
        in_shares(lambda *share, to=shares: to.append(share), count)
        assert [item for share in sorted(shares) for item in range(*share)] == list(range(count))
        assert side_by_side(*(lambda index=index: index for index in range(count))) == list(range(count))


@pytest.mark.parametrize("threads", ["1", "4"])
def test_a_call_that_fails_is_told_and_leaves_helpers_that_work(monkeypatch: pytest.MonkeyPatch, threads: str) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", threads)

    def fail() -> int:
        raise ValueError("told")

    with pytest.raises(ValueError, match="told"):
        side_by_side(lambda: 1, fail)
    assert side_by_side(lambda: 1, lambda: 2) == [1, 2]
