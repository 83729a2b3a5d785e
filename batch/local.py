"""A batch on one machine: clips run in parallel, each in a worker process, so that a crash ends only one of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from pdecodec.batch.clips import Clip
from pdecodec.batch.memory import AVAILABLE_SHARE, MemoryBudget, available_memory
from pdecodec.batch.work import Result, Work, failure, make_clip, memory_of
from pdecodec.errors import InputError
from pdecodec.system.shares import thread_count
from pdecodec.system.workers import Worker, WorkerEndedError, WorkerNotStartedError, call_workers


def run_local(
    clips: Sequence[Clip], work: Work, *, jobs: int | None = None, max_memory: int | None = None
) -> Iterator[Result]:
    """Encode every clip that is not done; yield results as clips finish.

    Parameters
    ----------
    clips : sequence of Clip
    work : Work
    jobs : int, optional
        Clips encoded at once; they share the processors. Default: one per processor.
    max_memory : int, optional [bytes]
        Estimated memory that clips encoded at once may take. Default: most of the memory that is free now.
    """
    jobs = min(jobs or thread_count(), len(clips))
    budget = MemoryBudget(max_memory or int(AVAILABLE_SHARE * available_memory()))
    threads = max(1, thread_count() // max(1, jobs))
    workers = [Worker(environment={"PDECODEC_THREADS": str(threads)}) for _ in range(jobs)]

    def make(worker: Worker, clip: Clip) -> Result:
        memory: Result | int = worker.call(memory_of, clip, work)
        if isinstance(memory, Result):
            return memory
        with budget.room(memory):
            made: Result = worker.call(make_clip, clip, work)
            return made

    for clip, found in call_workers(clips, make, workers):
        yield found if isinstance(found, Result) else failure(clip, _error_of_clip(found, clip))


def _error_of_clip(error: Exception, clip: Clip) -> Exception:
    """Return the error to report for a clip whose worker did not answer."""
    if isinstance(error, WorkerNotStartedError):
        message = f"no process could be started to encode it ({error})"
        return InputError(message, code="worker-ended", path=clip.source, setting="jobs", purpose="to take fewer")
    if isinstance(error, WorkerEndedError):
        message = f"the process that encoded it ended ({error}); check whether the file is damaged"
        return InputError(message, code="worker-ended", path=clip.source, setting="jobs", purpose="to take fewer")
    return error
