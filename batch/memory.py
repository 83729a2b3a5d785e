"""Estimate the memory that clips encoded in parallel take, and share what is available."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Condition

from pdecodec.codec.encoding_memory import encoding_bytes
from pdecodec.codec.settings import EncodeSettings

AVAILABLE_SHARE = 0.8
"""Share of the memory free at the start that a batch takes; other programs may grow, too."""

LIKELY_FRAMES = (16, 64, 256)
"""Numbers of frames to assume for a clip that is not open yet; for equal positions, fewer frames have more vertices."""

UNKNOWN_MEMORY = 4 * 2**30
"""Available memory to assume if the system does not report it [bytes]."""


def encoding_bytes_of_file(size: int, settings: EncodeSettings) -> int:
    """Return the memory to encode a file that cannot be opened yet [bytes], as if all its bytes were positions."""
    return max(encoding_bytes(frames, size // (12 * frames), settings) for frames in LIKELY_FRAMES)


def available_memory() -> int:
    """Return the bytes available without swapping out other programs, within the system and the control group."""
    found = []
    with suppress(OSError, ValueError, IndexError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        found.append(1024 * int(next(line for line in lines if line.startswith("MemAvailable:")).split()[1]))
    with suppress(OSError, ValueError):
        group = Path("/sys/fs/cgroup")
        limit = int((group / "memory.max").read_text())  # "max", which is not a number, if there is no limit
        found.append(limit - int((group / "memory.current").read_text()))
    if not found:
        with suppress(OSError, ValueError, AttributeError):
            found.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    return max(0, min(found, default=UNKNOWN_MEMORY))


class MemoryBudget:
    """Memory that several clips share: each waits until there is room for it, in order of arrival.

    Parameters
    ----------
    total : int [bytes]
        A clip that takes more is admitted when it is alone.
    """

    def __init__(self, total: int) -> None:
        self._total, self._used = total, 0
        self._waiting: deque[object] = deque()
        self._changed = Condition()

    @property
    def waiting(self) -> int:
        """Return how many clips wait for room."""
        return len(self._waiting)

    @contextmanager
    def room(self, size: int) -> Iterator[None]:
        """Wait for room for `size` bytes, and hold it until the block ends."""
        turn = object()
        with self._changed:
            self._waiting.append(turn)
            try:
                self._changed.wait_for(
                    lambda: self._waiting[0] is turn and (self._used == 0 or self._used + size <= self._total)
                )
                self._used += size
            finally:  # an interrupted clip must not keep the others waiting
                self._waiting.remove(turn)
                self._changed.notify_all()
        try:
            yield
        finally:
            with self._changed:
                self._used -= size
                self._changed.notify_all()
