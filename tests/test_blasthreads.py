"""Linear algebra takes one thread while a clip is encoded, and as many as before when it is done or has failed."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from pdecodec.blasthreads import blas_threads, one_blas_thread
from pdecodec.encoding.encoder import encode
from pdecodec.sequence import ArraySequence


def test_an_encode_takes_one_thread_and_gives_the_others_back() -> None:
    before, within = blas_threads(), []
    clip = ArraySequence(np.random.default_rng(0).normal(size=(6, 5, 3)).astype(np.float32))
    encode(clip, tolerance=1e-2, effort="fast", progress=lambda done, total, what: within.append(blas_threads()))
    assert before
    assert [set(threads) for threads in within] == [{1}]
    assert blas_threads() == before


def test_the_library_that_numpy_has_loaded_is_not_left_out() -> None:
    limited = blas_threads()
    maps = Path("/proc/self/maps")
    loaded = set(re.findall(r"\S*/numpy\S*/lib\w*openblas[^/\s]*", maps.read_text())) if maps.exists() else set()
    if not loaded:
        pytest.skip("no OpenBLAS is loaded, or this system does not list what is")
    assert len(loaded) <= len(limited)


def test_a_failure_gives_the_threads_back() -> None:
    before = blas_threads()
    with pytest.raises(ZeroDivisionError), one_blas_thread():
        raise ZeroDivisionError
    assert blas_threads() == before
