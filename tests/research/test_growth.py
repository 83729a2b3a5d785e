"""Tables of the growth of time and memory with the size of a clip."""

from __future__ import annotations

import pytest

from pdecodec.research.growth import Seconds, Size, exponent, measure_apart, rows


def test_sizes_are_measured_in_processes_of_their_own() -> None:
    pytest.importorskip("resource")
    small, large = measure_apart(4, 8, 4), measure_apart(40, 16, 10)
    assert (small.frames, small.vertices, large.frames, large.vertices) == (4, 64, 40, 256)
    for way in (small.encoding, small.decoding, large.encoding, large.decoding):
        assert 0 < way.first <= way.whole
    # The larger clip has three more groups, which take time; the smaller one has a single group.
    assert large.decoding.after > 0.2 * large.decoding.first
    assert small.decoding.after < 0.2 * small.decoding.first
    assert small.memory > 2**24
    assert small.file_bytes < large.file_bytes


def test_exponents_are_of_first_and_last_as_a_whole_and_after_the_first_group() -> None:
    assert exponent(0.5, 50, 100) == pytest.approx(1)
    assert exponent(2, 2, 10) == 0
    # Encoding takes 4 s for the first group and 0.01 s for each frame after it; decoding takes less and less per frame.
    small = Size(100, 64, 50, 999, Seconds(4.0, 4.5), Seconds(1.0, 2.0), 10**8)
    large = Size(10_000, 64, 50, 9999, Seconds(4.0, 103.5), Seconds(1.0, 12.0), 10**8)
    table = list(rows([small, large]))
    assert table[2] == "| 100 | 64 | 4.5 s | 4 s | 2 s | 1 s | 100 MB |"
    assert table[-2:] == [
        "Exponents: 0.68 of encoding, 0.39 of decoding.",
        "After the first group: 1.00 of encoding, 0.45 of decoding.",
    ]
    # With a single group, no time is left after the first one.
    one = [Size(12, vertices, 12, 999, Seconds(1.0, 1.0), Seconds(1.0, 1.0), 10**8) for vertices in (10, 100)]
    assert list(rows(one))[-1] == "Exponents: 0.00 of encoding, 0.00 of decoding."
