"""Interrupts that no library loses: Ctrl-C ends a command wherever it is.

Python raises KeyboardInterrupt wherever the program is. Extension modules that are being imported make another error
of it, and callbacks and destructors drop it. So an interrupt waits until nothing is being imported, and is raised again
until the command takes it.
"""

from __future__ import annotations

import signal
import sys
from types import FrameType

RETRY_SECONDS = 0.05
"""After which an interrupt is raised again that nobody has taken."""

_IMPORTING = "<frozen importlib._bootstrap>"

_is_interrupted = False


def watch_interrupts() -> None:
    """Begin, where interrupts are not ignored, as they are for what a shell runs in the background."""
    if hasattr(signal, "setitimer") and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        for number in (signal.SIGINT, signal.SIGALRM):
            signal.signal(number, _interrupt)
        shown = sys.unraisablehook
        sys.unraisablehook = lambda lost: None if lost.exc_type is KeyboardInterrupt else shown(lost)


def take_interrupt() -> bool:
    """Stop raising; whether there was an interrupt, whatever became of it. The next one ends the process at once."""
    if _is_interrupted:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _is_interrupted


def _interrupt(number: int, frame: FrameType | None) -> None:
    global _is_interrupted
    _is_interrupted = True
    signal.setitimer(signal.ITIMER_REAL, RETRY_SECONDS)
    # While an exception is handled the first one is on its way, and files are being removed.
    if not _is_importing(frame) and (number == signal.SIGINT or sys.exception() is None):
        raise KeyboardInterrupt


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None and frame.f_code.co_filename != _IMPORTING:
        frame = frame.f_back
    return frame is not None
