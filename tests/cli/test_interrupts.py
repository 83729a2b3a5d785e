"""Interrupts that come while processes are being started."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from multiprocessing import resource_tracker

import pytest

from pdecodec.system.interrupts import CAN_HOLD, end_when_interrupted, interrupts_held

pytestmark = pytest.mark.skipif(not CAN_HOLD, reason="signals cannot be held back here")

CHILD = """
import signal, sys
signal.raise_signal(signal.SIGINT)
print("started", flush=True)
sys.stdin.readline()
from pdecodec.system.interrupts import end_when_interrupted
end_when_interrupted()
print("unreachable")
"""


def test_an_interrupt_waits_until_a_process_that_is_started_can_end_without_a_word() -> None:
    with interrupts_held():
        process = subprocess.Popen(
            [sys.executable, "-c", CHILD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
    assert process.communicate(b"\n", timeout=120) == (b"started\n", b"")
    assert process.returncode == -signal.SIGINT


def end_of_a_worker() -> None:
    end_when_interrupted()


def test_the_first_process_that_multiprocessing_starts_is_held_too(capfd: pytest.CaptureFixture[str]) -> None:
    resource_tracker._resource_tracker._stop()
    with interrupts_held():
        process = multiprocessing.get_context("spawn").Process(target=end_of_a_worker)
        process.start()
    assert process.pid is not None
    os.kill(process.pid, signal.SIGINT)
    process.join(120)
    assert process.exitcode == -signal.SIGINT
    assert capfd.readouterr().err == ""


def test_an_interrupt_of_our_own_comes_when_the_block_ends() -> None:
    done = False
    # What a shell runs in the background ignores interrupts.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):  # noqa: PT012 - it comes behind the block
            with interrupts_held():
                signal.raise_signal(signal.SIGINT)
                done = True
            time.sleep(1)
    finally:
        signal.signal(signal.SIGINT, before)
    assert done
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
