"""Interrupts that no library can lose: Ctrl-C ends a command wherever it is.

Python raises KeyboardInterrupt wherever the program is. Extension modules that are being imported turn it into another
error; callbacks and destructors drop it. So an interrupt waits until no import is running, and is raised again until
the command handles it.
"""

from __future__ import annotations

import signal
import sys
from types import FrameType

RETRY_SECONDS = 0.05
"""Time after which an interrupt that nothing handled is raised again [s]."""

_IMPORTING = "<frozen importlib._bootstrap>"

_is_interrupted = False


def watch_interrupts() -> None:
    """Install the handlers, unless interrupts are ignored, as they are for a shell's background jobs."""
    if hasattr(signal, "setitimer") and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        for number in (signal.SIGINT, signal.SIGALRM):
            signal.signal(number, _interrupt)
        shown = sys.unraisablehook
        sys.unraisablehook = lambda lost: None if lost.exc_type is KeyboardInterrupt else shown(lost)


def take_interrupt() -> bool:
    """Stop raising interrupts; return whether there was one. The next one ends the process at once."""
    if _is_interrupted:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _is_interrupted


def _interrupt(number: int, frame: FrameType | None) -> None:
    global _is_interrupted
    _is_interrupted = True
    signal.setitimer(signal.ITIMER_REAL, RETRY_SECONDS)
    # While an exception is being handled, the first interrupt is unwinding and files are being removed.
    if not _is_importing(frame) and (number == signal.SIGINT or sys.exception() is None):
        raise KeyboardInterrupt


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None and frame.f_code.co_filename != _IMPORTING:
        frame = frame.f_back
    return frame is not None
