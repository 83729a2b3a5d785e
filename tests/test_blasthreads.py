"""Linear algebra takes one thread while a clip is encoded, and as many as before when it is done or has failed."""

from __future__ import annotations

import pytest
from threadpoolctl import threadpool_info

from pdecodec.blasthreads import one_blas_thread


def blas_threads() -> list[int]:
    return [entry["num_threads"] for entry in threadpool_info() if entry["user_api"] == "blas"]


def test_within_there_is_one_thread_and_afterwards_as_many_as_before() -> None:
    before = blas_threads()
    assert before
    with one_blas_thread():
        assert set(blas_threads()) == {1}
        with one_blas_thread():
            assert set(blas_threads()) == {1}
    assert blas_threads() == before


def test_a_failure_gives_the_threads_back() -> None:
    before = blas_threads()
    with pytest.raises(ZeroDivisionError), one_blas_thread():
        raise ZeroDivisionError
    assert blas_threads() == before
