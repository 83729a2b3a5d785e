"""A batch on one machine: clips side by side, each in a process of its own that the others outlive."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection
from queue import SimpleQueue
from threading import Event, Lock, Thread
from typing import Any

from pdecodec.batch.clips import Clip
from pdecodec.batch.memory import AVAILABLE_SHARE, MemoryBudget, available_memory
from pdecodec.batch.work import Look, Result, Work, failure, look_at, make_clip
from pdecodec.errors import InputError
from pdecodec.system.interrupts import interrupts_held
from pdecodec.system.shares import thread_count


def run_local(
    clips: Sequence[Clip], work: Work, *, jobs: int | None = None, max_memory: int | None = None
) -> Iterator[Result]:
    """Make every clip that is not done; results in the order in which clips are done with.

    Parameters
    ----------
    clips : sequence of Clip
    work : Work
    jobs : int, optional
        Clips at once; the processors are shared among them. Default: one for each processor.
    max_memory : int, optional [bytes]
        What clips that are coded at once may take together, by estimate. Default: most of what is free now.
    """
    jobs = min(jobs or thread_count(), len(clips))
    budget = MemoryBudget(max_memory or int(AVAILABLE_SHARE * available_memory()))
    left, found, stopped = _Clips(clips, jobs), SimpleQueue[Result | None](), Event()
    workers = [_Worker(max(1, thread_count() // max(1, jobs))) for _ in range(jobs)]

    def serve(worker: _Worker) -> None:
        try:
            while not stopped.is_set() and (clip := left.next()) is not None:
                try:
                    found.put(worker.do(clip, work, budget))
                except _NotStartedError as error:
                    if left.is_left_to_others(clip):
                        break
                    found.put(failure(clip, InputError(str(error), path=clip.source)))
                except Exception as error:  # whatever one clip meets, the others go on
                    found.put(failure(clip, error))
        finally:
            worker.end()
            found.put(None)

    threads = [Thread(target=serve, args=(worker,), daemon=True) for worker in workers]
    try:
        for thread in threads:
            thread.start()
        busy = len(threads)
        while busy:
            result = found.get()
            if result is None:
                busy -= 1
            else:
                yield result
    finally:
        stopped.set()
        for worker in workers:
            worker.end()


class _NotStartedError(Exception):
    """A process that could not be started: the system allows no more of them, or no more open files."""


class _Clips:
    """Clips that nobody does yet, and how many take them."""

    def __init__(self, clips: Sequence[Clip], takers: int) -> None:
        self._clips, self._takers, self._lock = deque(clips), takers, Lock()

    def next(self) -> Clip | None:
        """A clip; None where there are no more, for one who then asks no further."""
        with self._lock:
            if self._clips:
                return self._clips.popleft()
            self._takers -= 1
            return None

    def is_left_to_others(self, clip: Clip) -> bool:
        """Give a clip back and ask no further; False, and nothing is given back, where nobody else is there."""
        with self._lock:
            if self._takers == 1:
                return False
            self._takers -= 1
            self._clips.appendleft(clip)
            return True


class _Worker:
    """A process that does one clip after the other, started when it is first needed and again when it ended."""

    _starting = Lock()
    """Processes start one after the other: what one needs of open files meanwhile may be all that there are."""

    def __init__(self, threads: int) -> None:
        self._threads = threads
        self._process: Any = None
        self._pipe: Connection | None = None
        self._lock, self._over = Lock(), Event()

    def do(self, clip: Clip, work: Work, budget: MemoryBudget) -> Result:
        """What becomes of a clip; a process that ends on it is its failure.

        Raises
        ------
        _NotStartedError
            If there can be no process.
        """
        look: Result | Look = self._call(look_at, clip, work)
        if isinstance(look, Result):
            return look
        with budget.room(look.memory):
            made: Result = self._call(make_clip, clip, work)
            return made

    def _call(self, function: Callable[..., Any], clip: Clip, work: Work) -> Any:
        with self._lock:
            if self._over.is_set():
                return failure(clip, InputError("the batch was stopped", path=clip.source))
            if self._process is None:
                with self._starting:
                    self._start()
            pipe, process = self._pipe, self._process
        assert pipe is not None
        try:
            pipe.send((function, clip, work))
            return pipe.recv()
        except (EOFError, OSError):
            # Two threads that wait for one process at once: the second never learns how it ended.
            with self._lock:
                process.join()
                code, self._process = process.exitcode, None
                if self._over.is_set():
                    return failure(clip, InputError("the batch was stopped", path=clip.source))
            reason = f"signal {-code}" if code < 0 else f"exit code {code}"
            if code == -getattr(signal, "SIGKILL", 9):
                reason += ", as where memory runs out"
            message = f"the process that coded it ended ({reason}); see whether the file is damaged, take fewer --jobs"
            return failure(clip, InputError(message, path=clip.source))

    def _start(self) -> None:
        """Start the process; :class:`_NotStartedError` where it cannot be."""
        context = multiprocessing.get_context("spawn")
        try:
            self._pipe, theirs = context.Pipe()
            with theirs:
                process = context.Process(target=_serve, args=(theirs, self._threads), daemon=True)
                with interrupts_held():
                    process.start()
        except (OSError, ImportError) as error:  # what starts processes is imported only now
            if self._pipe is not None:
                self._pipe.close()
            reason = error.strerror if isinstance(error, OSError) else error
            raise _NotStartedError(f"no process could be started to code it ({reason}); take fewer --jobs") from error
        self._process = process

    def end(self) -> None:
        """End the process, whatever it is doing."""
        with self._lock:
            self._over.set()
            if self._process is not None:
                self._process.kill()
                self._process.join()


def _serve(pipe: Connection, threads: int) -> None:
    """Answer calls until there are no more; in the process."""
    # Who runs the batch decides when it ends; the terminal's interrupt goes to all of its processes.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ["PDECODEC_THREADS"] = str(threads)
    while True:
        try:
            function, clip, work = pipe.recv()
        except EOFError:
            return
        pipe.send(function(clip, work))
