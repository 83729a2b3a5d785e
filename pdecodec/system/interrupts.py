"""Interrupts and processes that are being started: a terminal sends them to all, and what is loading says where it was.

A process inherits which signals are held back. So it is started with interrupts held, and lets them come where it knows
what to do about them.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker

CAN_HOLD = hasattr(signal, "pthread_sigmask")
"""Not on Windows, where a process that is being started prints where it was."""


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold interrupts back from this thread until the block ends, and from processes started inside until they ask."""
    if not CAN_HOLD:
        yield
        return
    # It lets interrupts come when it has been started, which the first process would do.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_when_interrupted() -> None:
    """Let an interrupt end this process without a word: one that came while it was being started, too."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if CAN_HOLD:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
