"""Linear algebra takes one thread while a clip is encoded, and as many as before when it is done or has failed."""

from __future__ import annotations

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from pdecodec.blasthreads import one_blas_thread
from pdecodec.encoder import encode
from pdecodec.sequence import ArraySequence


def blas_threads() -> dict[str, int]:
    """Of each library of linear algebra that is loaded by now, by its file."""
    return {entry["filepath"]: entry["num_threads"] for entry in threadpool_info() if entry["user_api"] == "blas"}


def test_an_encode_takes_one_thread_and_gives_the_others_back() -> None:
    before, within = blas_threads(), []
    clip = ArraySequence(np.random.default_rng(0).normal(size=(6, 5, 3)).astype(np.float32))
    encode(clip, tolerance=1e-2, effort="fast", progress=lambda done, total, what: within.append(blas_threads()))
    assert before
    assert [{threads[library] for library in before} for threads in within] == [{1}]
    assert before.items() <= blas_threads().items()


def test_a_failure_gives_the_threads_back() -> None:
    before = blas_threads()
    with pytest.raises(ZeroDivisionError), one_blas_thread():
        raise ZeroDivisionError
    assert blas_threads() == before
