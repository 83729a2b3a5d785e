"""How much memory clips take that are coded side by side, and how much there is."""

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
"""Of the memory that is free when a batch begins: what else runs on the machine grows, too."""

LIKELY_FRAMES = (16, 64, 256)
"""Of a clip that nobody has looked at yet: of as many positions, few frames have many vertices."""

UNKNOWN_MEMORY = 4 * 2**30
"""Where the system does not say how much there is [bytes]."""


def encoding_bytes_of_file(size: int, settings: EncodeSettings) -> int:
    """Memory that encoding a file takes that cannot be looked at yet: as if all its bytes were positions."""
    return max(encoding_bytes(frames, size // (12 * frames), settings) for frames in LIKELY_FRAMES)


def available_memory() -> int:
    """Bytes that can be taken without another program being pushed out, by the system and by the control group."""
    found = []
    with suppress(OSError, ValueError, IndexError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        found.append(1024 * int(next(line for line in lines if line.startswith("MemAvailable:")).split()[1]))
    with suppress(OSError, ValueError):
        group = Path("/sys/fs/cgroup")
        limit = int((group / "memory.max").read_text())  # "max", which is no number, where there is none
        found.append(limit - int((group / "memory.current").read_text()))
    if not found:
        with suppress(OSError, ValueError, AttributeError):
            found.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    return max(0, min(found, default=UNKNOWN_MEMORY))


class MemoryBudget:
    """Memory that several clips share: each waits until there is room for it, those that came first at first.

    Parameters
    ----------
    total : int [bytes]
        A clip that takes more is let in where it is alone.
    """

    def __init__(self, total: int) -> None:
        self._total, self._used = total, 0
        self._waiting: deque[object] = deque()
        self._changed = Condition()

    @property
    def waiting(self) -> int:
        """How many clips wait for room."""
        return len(self._waiting)

    @contextmanager
    def room(self, size: int) -> Iterator[None]:
        """Room for `size` bytes, taken when there is as much, and given back."""
        turn = object()
        with self._changed:
            self._waiting.append(turn)
            try:
                self._changed.wait_for(
                    lambda: self._waiting[0] is turn and (self._used == 0 or self._used + size <= self._total)
                )
                self._used += size
            finally:  # whoever is interrupted here does not keep the others waiting
                self._waiting.remove(turn)
                self._changed.notify_all()
        try:
            yield
        finally:
            with self._changed:
                self._used -= size
                self._changed.notify_all()
