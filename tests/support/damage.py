"""Damage to encoded data, for tests of all code that reads bytes: truncated, extended, overwritten."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pdecodec.errors import CorruptFileError
from spec.sealing import table_end, take_apart, take_runs


def assert_cuts_are_refused(data: bytes, decode: Callable[[bytes], object]) -> None:
    """Assert that data that are cut short (but not empty) or have extra bytes raise CorruptFileError."""
    for size in range(1, len(data)):
        with pytest.raises(CorruptFileError):
            decode(data[:size])
    for more in (b"\0", b"\xff", data):
        with pytest.raises(CorruptFileError):
            decode(data + more)


def assert_only_corrupt_file_errors(data: bytes, decode: Callable[[bytes], object], *, seed: int = 0) -> int:
    """Overwrite bytes, one at a time and several together; return how many of the results were refused.

    Any error but CorruptFileError fails the test. Damage may go unnoticed: checksums belong to the container.
    """
    random = np.random.default_rng(seed)
    damaged = [
        bytearray(data[:at] + bytes([data[at] ^ mask]) + data[at + 1 :])
        for at in range(len(data))
        for mask in (0x01, 0x80, 0xFF)
    ]
    for _ in range(200):
        several = bytearray(data)
        for at in random.integers(0, len(data), 3):
            several[at] = random.integers(0, 256)
        damaged.append(several)
    refused = 0
    for each in damaged:
        try:
            with np.errstate(all="ignore"):  # as in the decoder: numbers in a malicious file may overflow
                decode(bytes(each))
        except CorruptFileError:
            refused += 1
    return refused


def place_in_run(data: bytes, run: int, kind: str) -> tuple[int, int]:
    """Return offset and length of a section of one run, in a file of several runs."""
    parts = take_apart(data)
    kinds = [part.kind for part in parts]
    offset = table_end(parts) + sum(len(part.content) for part in parts[: kinds.index("RDAT")])
    runs = take_runs(parts)
    offset += sum(len(before.data) for before in runs[:run])
    for name, section in runs[run].sections.items():
        if name == kind:
            return offset, len(section or b"")
        offset += len(section or b"")
    raise KeyError(kind)
