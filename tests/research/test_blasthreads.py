"""numpy's linear algebra is limited to one thread while the paper's method is measured, and the number is
restored afterwards.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pdecodec.research.reproduction.blasthreads import blas_threads, one_blas_thread


def test_one_thread_is_taken_within_and_the_others_are_given_back() -> None:
    before = blas_threads()
    assert before
    with one_blas_thread():
        assert set(blas_threads()) == {1}
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
