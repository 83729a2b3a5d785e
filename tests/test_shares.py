"""Shares of work: every item once, from any number of threads, and errors come out."""

from __future__ import annotations

import threading
from functools import partial

import pytest

from pdecodec import shares


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, 7, 100])
def test_shares_cover_every_item_once(count: int, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shares, "thread_count", lambda: threads)
    seen = [0] * count

    def work(first: int, end: int) -> None:
        assert first < end
        for item in range(first, end):
            seen[item] += 1

    shares.in_shares(work, count)
    assert seen == [1] * count


@pytest.mark.parametrize("threads", [1, 3])
def test_an_error_in_a_share_comes_out(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shares, "thread_count", lambda: threads)

    def work(first: int, end: int) -> None:
        if first <= 42 < end:
            raise ValueError("item 42")

    with pytest.raises(ValueError, match="item 42"):
        shares.in_shares(work, 100)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_results_side_by_side_come_in_the_order_of_their_calls(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shares, "thread_count", lambda: threads)
    assert shares.side_by_side(*(partial(pow, k, 2) for k in range(9))) == [k * k for k in range(9)]
    assert shares.side_by_side() == []


def test_calls_side_by_side_run_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shares, "thread_count", lambda: 2)
    both = threading.Barrier(2, timeout=60)
    assert sorted(shares.side_by_side(both.wait, both.wait)) == [0, 1]
