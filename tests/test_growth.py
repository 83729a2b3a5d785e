"""The measurement of growth measures what it says."""

from __future__ import annotations

import pytest

from pdecodec.report.growth import exponent, measure_apart, rows


def test_sizes_are_measured_in_processes_of_their_own_and_exponents_are_of_first_and_last() -> None:
    pytest.importorskip("resource")
    small, large = measure_apart(4, 8), measure_apart(40, 16)
    assert (small.frames, small.vertices, large.frames, large.vertices) == (4, 64, 40, 256)
    assert min(small.encode_seconds, small.decode_seconds, large.encode_seconds) > 0
    assert small.memory > 2**24
    assert small.file_bytes < large.file_bytes
    assert exponent(0.5, 50, 100) == pytest.approx(1)
    assert exponent(2, 2, 10) == 0
    table = list(rows([small, large], 40))
    assert table[2].startswith("| 4 | 64 | ")
    assert table[-1].startswith(
        f"Exponents: {exponent(small.encode_seconds, large.encode_seconds, 40):.2f} of encoding"
    )
