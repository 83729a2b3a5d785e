"""Worker processes: each runs calls in a separate process, so that the end of that process is only an error here.

A request is a pickle of a function, by its name, and its arguments. An answer is the function's result or exception:
also a pickle, or, if a damaged file might take over the process, a NumPy archive without pickles. Each message is
sent through a pipe, preceded by its length. Begin with :class:`Worker`; :func:`call_workers` shares items among
several.

A terminal sends an interrupt to all processes at once. A worker ignores it from its start: the process that started
it ends it.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import pickle
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from queue import SimpleQueue
from threading import Event, Lock, Thread
from typing import IO, Any, TypeVar

from pdecodec.errors import (
    CorruptFileError,
    InputError,
    LimitError,
    MissingExtraError,
    MissingFileError,
    PdecodecError,
    SettingsError,
    damaged,
)

Item = TypeVar("Item")
Result = TypeVar("Result")

CAN_HOLD_INTERRUPTS = hasattr(signal, "pthread_sigmask")
"""Whether interrupts can be held back. Not on Windows, where an interrupt makes a starting process print a
traceback.
"""

_LENGTH_BYTES = 8

_NO_ANSWER = (EOFError, OSError, ValueError, OverflowError, MemoryError)
"""Errors of reading from a process that ended, was ended meanwhile, or sent an impossible length."""

_FAILURE = "failure of the call"
"""Name of the array that holds a failure, as JSON, in answers without pickles."""

_LEAVES = {
    one.__name__: one
    for one in (SettingsError, InputError, MissingFileError, CorruptFileError, LimitError, MissingExtraError)
}
"""Errors that can be returned without pickles."""


class WorkerError(Exception):
    """A worker could not answer; the message is the reason, worded for use in parentheses."""


class WorkerNotStartedError(WorkerError):
    """The system allows no more processes, or no more open files."""


class WorkerEndedError(WorkerError):
    """The process ended during a call: with an exit code, or minus the number of a signal; None if we ended it."""

    def __init__(self, exit_code: int | None) -> None:
        self.exit_code = exit_code
        if exit_code is None:
            reason = "stopped"
        elif exit_code >= 0:
            reason = f"exit code {exit_code}"
        else:
            is_kill = exit_code == -getattr(signal, "SIGKILL", 9)
            reason = f"signal {-exit_code}{', probably out of memory' if is_kill else ''}"
        super().__init__(reason)


class Worker:
    """A process that answers calls, one at a time. The first call starts it, as does a call after it ended or after a
    fork.

    Parameters
    ----------
    arrays_only : bool
        Accept no pickles from the process, and hide its prints: functions return arrays by name.
    environment : mapping of str to str, optional
        Variables that the process has in addition to those of this process.
    """

    _starting = Lock()
    """Processes start one after the other: starting one may need all remaining file descriptors for a moment."""

    def __init__(self, *, arrays_only: bool = False, environment: Mapping[str, str] | None = None) -> None:
        self._arrays_only, self._environment = arrays_only, environment or {}
        self._calling, self._changing = Lock(), Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0
        self._is_over = False

    def call(self, function: Callable[..., Any], /, *arguments: Any, **named: Any) -> Any:
        """Call a function of a module in the process, and return its result.

        Raises
        ------
        WorkerNotStartedError, WorkerEndedError
            If there is no answer.
        Exception
            Any error of the function; with `arrays_only` a leaf of PdecodecError, without its path.
        """
        request = pickle.dumps((function, arguments, named))
        with self._calling:
            process = self._started()
            try:
                assert process.stdin is not None
                assert process.stdout is not None
                _send(process.stdin, request)
                answer, error = (_unpack_arrays if self._arrays_only else pickle.loads)(_receive(process.stdout))
            except _NO_ANSWER as reason:
                raise self._ended(process) from reason
            except BaseException:
                # Otherwise its late answer would be taken for the answer to the next request.
                self._stop(process)
                raise
        if error is not None:
            raise error
        return answer

    def end(self) -> None:
        """End the process, whatever it is doing; no more calls are possible."""
        with self._changing:
            self._is_over = True
            process = self._process
        if process is not None and self._owner == os.getpid():
            self._stop(process)

    def __del__(self) -> None:
        self.end()

    @property
    def process_id(self) -> int | None:
        """Number of the process; None if none has been started, or it ended in a call."""
        process = self._process
        return None if process is None else process.pid

    def _started(self) -> subprocess.Popen[bytes]:
        with self._changing:
            if self._is_over:
                raise WorkerEndedError(None)
            if self._process is None or self._owner != os.getpid():
                # The process must find modules where this process finds them.
                code = f"import sys; sys.path[:] = {sys.path!r}; from pdecodec.system.workers import serve; "
                try:
                    with self._starting, interrupts_held():
                        self._process = subprocess.Popen(
                            [sys.executable, "-c", f"{code}serve(arrays_only={self._arrays_only})"],
                            stdin=subprocess.PIPE,
                            stdout=subprocess.PIPE,
                            stderr=subprocess.DEVNULL if self._arrays_only else None,
                            env={**os.environ, **self._environment},
                        )
                except OSError as error:
                    raise WorkerNotStartedError(error.strerror or str(error)) from error
                self._owner = os.getpid()
            return self._process

    def _ended(self, process: subprocess.Popen[bytes]) -> WorkerEndedError:
        """Return the error for a process that no longer answers."""
        if not self._arrays_only:
            process.wait()  # It closed its pipes, so it is ending; its exit code tells the reason.
        self._stop(process)
        with self._changing:
            return WorkerEndedError(None if self._is_over else process.returncode)

    def _stop(self, process: subprocess.Popen[bytes]) -> None:
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        with self._changing:
            if self._process is process:
                self._process = None


def call_workers(
    items: Sequence[Item], work: Callable[[Worker, Item], Result], workers: Sequence[Worker]
) -> Iterator[tuple[Item, Result | Exception]]:
    """Yield each item with the result or the exception of `work` for it, in the order in which items are done.

    Parameters
    ----------
    items : sequence
    work : callable
        ``work(worker, item)`` calls the worker; it runs in one thread per worker. An item whose worker cannot be
        started goes to another worker, as long as there is one.
    workers : sequence of Worker
        Ended together with the iterator.
    """
    left, takers, lock, is_stopped = deque(items), len(workers), Lock(), Event()
    found = SimpleQueue[tuple[Item, Result | Exception] | None]()

    def next_items() -> list[Item]:
        """Return the next item; if there are no more, return an empty list, and stop this thread."""
        nonlocal takers
        with lock:
            takers -= not left
            return [left.popleft()] if left else []

    def is_given_back(item: Item) -> bool:
        """Leave an item to the other threads, and stop this one; return False if there is no other thread."""
        nonlocal takers
        with lock:
            if takers == 1:
                return False
            takers -= 1
            left.appendleft(item)
            return True

    def take(worker: Worker) -> None:
        try:
            while not is_stopped.is_set() and (items := next_items()):
                [item] = items
                try:
                    found.put((item, work(worker, item)))
                except WorkerNotStartedError as error:
                    if is_given_back(item):
                        break
                    found.put((item, error))
                except Exception as error:  # An error of one item must not stop the others.
                    found.put((item, error))
        finally:
            worker.end()
            found.put(None)

    threads = [Thread(target=take, args=(worker,), daemon=True) for worker in workers]
    try:
        for thread in threads:
            thread.start()
        busy = len(threads)
        while busy:
            done = found.get()
            if done is None:
                busy -= 1
            else:
                yield done
    finally:
        is_stopped.set()
        for worker in workers:
            worker.end()


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold back interrupts from this thread until the block ends; processes that are started inside inherit this."""
    if not CAN_HOLD_INTERRUPTS:
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def serve(*, arrays_only: bool) -> None:
    """Answer requests until there are no more; runs in the process of a worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if CAN_HOLD_INTERRUPTS:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    # Functions may read, print and start processes, none of which may get the pipes.
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    for standard in (0, 1):
        os.dup2(nothing, standard)
    os.close(nothing)
    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            request = _receive(requests)
            try:
                function, arguments, named = pickle.loads(request)
                answer = function(*arguments, **named)
                data = _pack_arrays(answer) if arrays_only else pickle.dumps((answer, None))
            except Exception as error:  # Every exception of a function is returned to the caller.
                data = _pack_failure(error) if arrays_only else _pickle_failure(error)
            _send(answers, data)


def _send(pipe: IO[bytes], data: bytes) -> None:
    pipe.write(len(data).to_bytes(_LENGTH_BYTES, "little"))
    pipe.write(data)
    pipe.flush()


def _receive(pipe: IO[bytes]) -> bytes:
    """Return the next message; EOFError if the other end is closed."""
    head = pipe.read(_LENGTH_BYTES)
    size = int.from_bytes(head, "little")
    data = pipe.read(size) if len(head) == _LENGTH_BYTES else b""
    if not data or len(data) < size:
        raise EOFError
    return data


def _pickle_failure(error: Exception) -> bytes:
    import traceback

    error.add_note("".join(traceback.format_exception(error)))
    return pickle.dumps((None, error))


def _pack_arrays(arrays: Mapping[str, Any]) -> bytes:
    import numpy as np

    data = io.BytesIO()
    np.savez(data, **arrays)
    return data.getvalue()


def _pack_failure(error: Exception) -> bytes:
    if not isinstance(error, PdecodecError):
        error = damaged(" ".join(str(error).split()) or type(error).__name__)
    return _pack_arrays({_FAILURE: json.dumps((type(error).__name__, error.fields()))})


def _unpack_arrays(data: bytes) -> tuple[dict[str, Any], PdecodecError | None]:
    import numpy as np

    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = dict(archive)
        if _FAILURE not in arrays:
            return arrays, None
        kind, fields = json.loads(str(arrays[_FAILURE]))
        return {}, _LEAVES[kind](**fields)
    except Exception as error:  # A process that was taken over can answer anything.
        raise EOFError from error
