"""Worker processes: answers, failures, processes that end, interrupts, and calls that are given up."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pdecodec.errors import CorruptFileError, InputError, SettingsError
from pdecodec.system.workers import (
    CAN_HOLD_INTERRUPTS,
    Worker,
    WorkerEndedError,
    WorkerNotStartedError,
    call_workers,
    interrupts_held,
)

can_hold = pytest.mark.skipif(not CAN_HOLD_INTERRUPTS, reason="signals cannot be held back here")


@pytest.fixture
def worker() -> Iterator[Worker]:
    one = Worker(environment={"PDECODEC_THREADS": "3"})
    yield one
    one.end()


def fail(kind: type[Exception]) -> None:
    raise kind("is odd")


def arrays(value: float) -> dict[str, object]:
    print("noise of a library")
    return {"values": np.full(3, value), "names": np.array(["a", "b"])}


def objects() -> dict[str, object]:
    return {"values": np.array([Path()], object)}


def fail_at(kind: type[InputError], frame: int) -> None:
    raise kind("is odd", path="elsewhere", frame=frame)


def garbage() -> None:
    """Answer with bytes that are no reply, as a process does after a damaged file has taken control of it."""
    os.write(max(map(int, os.listdir("/proc/self/fd"))) - 1, b"\xff" * 100)


def test_a_worker_answers_call_after_call_in_one_process_of_its_own(worker: Worker) -> None:
    numbers = {worker.call(os.getpid) for _ in range(3)}
    assert numbers == {worker.process_id}
    assert numbers != {os.getpid()}
    assert worker.call(os.getenv, "PDECODEC_THREADS") == "3"
    assert worker.call(int, "11", base=2) == 3


def test_an_error_of_a_function_is_returned_and_the_process_continues(worker: Worker) -> None:
    before = worker.call(os.getpid)
    for kind in (SettingsError, ZeroDivisionError):
        with pytest.raises(kind, match="is odd") as caught:
            worker.call(fail, kind)
        assert "in fail" in caught.value.__notes__[0]
    assert worker.call(os.getpid) == before


def test_a_process_that_ends_is_an_error_with_its_exit_code_and_the_next_call_starts_another(worker: Worker) -> None:
    with pytest.raises(WorkerEndedError, match="exit code 7") as caught:
        worker.call(os._exit, 7)
    assert caught.value.exit_code == 7
    number = worker.call(os.getpid)
    os.kill(number, signal.SIGKILL)
    with pytest.raises(WorkerEndedError, match="signal 9, probably out of memory"):
        worker.call(os.getpid)
    assert worker.call(os.getpid) != number


@pytest.mark.parametrize("_attempt", range(4))  # both threads wait for the process, in either order
def test_ending_a_worker_amid_a_call_is_the_failure_of_that_call_and_of_later_ones(
    worker: Worker, _attempt: int
) -> None:
    said: list[str] = []

    def wait() -> None:
        for _ in range(2):
            with pytest.raises(WorkerEndedError, match="stopped") as caught:
                worker.call(time.sleep, 600)
            said.append(str(caught.value))

    call = threading.Thread(target=wait)
    call.start()
    while worker.process_id is None:
        time.sleep(0.01)
    worker.end()
    call.join()
    assert said == ["stopped"] * 2


def test_arrays_alone_come_back_where_no_pickles_are_taken() -> None:
    worker = Worker(arrays_only=True)
    try:
        found = worker.call(arrays, 2.0)
        assert (found["values"].tolist(), found["names"].tolist()) == ([2.0] * 3, ["a", "b"])
        with pytest.raises(WorkerEndedError):
            worker.call(objects)
        with pytest.raises(CorruptFileError, match="is odd") as caught:
            worker.call(fail_at, CorruptFileError, 5)
        assert (caught.value.frame, caught.value.path) == (5, "elsewhere")
        with pytest.raises(InputError, match="is odd"):
            worker.call(fail, ZeroDivisionError)
    finally:
        worker.end()


@pytest.mark.skipif(sys.platform != "linux", reason="finds the pipe as Linux shows it")
def test_a_process_that_answers_nonsense_is_ended() -> None:
    worker = Worker(arrays_only=True)
    try:
        with pytest.raises(WorkerEndedError):
            worker.call(garbage)
        assert worker.process_id is None
    finally:
        worker.end()


def test_items_are_done_by_all_workers_and_what_one_meets_is_its_own() -> None:
    def work(worker: Worker, item: int) -> int:
        found: int = worker.call(os._exit, 3) if item == 4 else worker.call(divmod, 12, item)[0]
        return found

    found = dict(call_workers(range(6), work, [Worker(), Worker()]))
    assert {item: one for item, one in found.items() if isinstance(one, int)} == {1: 12, 2: 6, 3: 4, 5: 2}
    assert isinstance(found[0], ZeroDivisionError)
    assert isinstance(found[4], WorkerEndedError)


def test_an_item_whose_worker_cannot_be_started_is_done_by_another() -> None:
    workers = [Worker() for _ in range(3)]

    def started(worker: Worker, item: int) -> int:
        if worker is not workers[0]:
            raise WorkerNotStartedError("no more processes")
        found: int = worker.call(abs, item)
        return found

    assert dict(call_workers(range(4), started, workers)) == {0: 0, 1: 1, 2: 2, 3: 3}

    def not_started(worker: Worker, item: int) -> int:
        raise WorkerNotStartedError("no more processes")

    found = dict(call_workers(range(4), not_started, [Worker() for _ in range(3)]))
    assert [type(found[item]) for item in range(4)] == [WorkerNotStartedError] * 4


def test_closing_the_results_ends_the_workers() -> None:
    workers = [Worker(), Worker()]
    coming = call_workers(range(3), lambda worker, item: worker.call(time.sleep, 600 * item), workers)
    assert next(coming) == (0, None)
    coming.close()  # type: ignore[attr-defined]
    for worker in workers:
        assert worker.process_id is None


@can_hold
def test_an_interrupt_does_not_end_a_worker_that_is_started_or_at_work(
    worker: Worker, capfd: pytest.CaptureFixture[str]
) -> None:
    said: list[int] = []
    call = threading.Thread(target=lambda: said.append(worker.call(os.getpid)))
    call.start()
    while worker.process_id is None:
        time.sleep(0.001)
    for _ in range(100):  # the signal comes while the process loads what it needs, and later
        os.kill(worker.process_id, signal.SIGINT)
        time.sleep(0.001)
    call.join()
    os.kill(worker.process_id, signal.SIGINT)
    assert said == [worker.call(os.getpid)]
    assert capfd.readouterr() == ("", "")


@can_hold
def test_an_interrupted_call_leaves_no_answer_for_the_next_one(worker: Worker) -> None:
    worker.call(os.getpid)
    # Shells start background processes with interrupts ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        main = threading.main_thread().ident
        threading.Timer(0.2, signal.pthread_kill, [main, signal.SIGINT]).start()
        with pytest.raises(KeyboardInterrupt):
            worker.call(time.sleep, 600)
    finally:
        signal.signal(signal.SIGINT, before)
    assert worker.call(abs, -2) == 2


@can_hold
def test_an_interrupt_of_our_own_comes_when_the_block_ends() -> None:
    done = False
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
