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
from pdecodec.shares import thread_count


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
    left, found, stopped = deque(clips), SimpleQueue[Result | None](), Event()
    workers = [_Worker(max(1, thread_count() // max(1, jobs))) for _ in range(jobs)]

    def serve(worker: _Worker) -> None:
        while not stopped.is_set():
            try:
                clip = left.popleft()
            except IndexError:
                break
            found.put(worker.do(clip, work, budget))
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


class _Worker:
    """A process that does one clip after the other, started when it is first needed and again when it ended."""

    def __init__(self, threads: int) -> None:
        self._threads = threads
        self._process: Any = None
        self._pipe: Connection | None = None
        self._lock, self._over = Lock(), Event()

    def do(self, clip: Clip, work: Work, budget: MemoryBudget) -> Result:
        """What becomes of a clip; a process that ends on it is its failure."""
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
                context = multiprocessing.get_context("spawn")
                self._pipe, theirs = context.Pipe()
                self._process = context.Process(target=_serve, args=(theirs, self._threads), daemon=True)
                self._process.start()
                theirs.close()
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
