"""A batch on many machines: clips are tasks of a Dask cluster, whose workers see the same folders and addresses."""

from __future__ import annotations

import os
from asyncio import CancelledError
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import Any

from pdecodec.batch.clips import Clip
from pdecodec.batch.memory import AVAILABLE_SHARE, MemoryBudget, available_memory
from pdecodec.batch.records import STATE_FOLDER
from pdecodec.batch.work import Result, Work, do_clip, failure
from pdecodec.errors import InputError, MissingExtraError, PdecodecError
from pdecodec.system.storage import is_address
from pdecodec.system.whole_output import write_errors

CONNECT_SECONDS = 20
"""Time to wait for a scheduler's answer [s]."""

TASKS_AT_ONCE = 10_000
"""Tasks submitted at once: more than a cluster does in a minute, and few enough for a fast scheduler."""

_budgets: dict[int | None, MemoryBudget] = {}
_budgets_lock = Lock()


def run_on_cluster(
    clips: Sequence[Clip], work: Work, address: str, *, max_memory: int | None = None
) -> Iterator[Result]:
    """Encode every clip that is not done, on the workers of a Dask cluster; yield results as clips finish.

    If a worker ends, another one takes over its clips; the records tell which clips are done. A clip on which several
    workers end counts as failed.

    Parameters
    ----------
    clips : sequence of Clip
    work : Work
        Its folder and the paths of clips must be on storage that the workers see under the same names.
    address : str
        Address of the scheduler (``tcp://host:8786``), or the path of its scheduler file.
    max_memory : int, optional [bytes]
        Estimated memory that all clips encoded at once in one worker process may take. Default: most of the free memory
        that the worker may take.

    Raises
    ------
    MissingExtraError
        If the extra ``dask`` is not installed.
    InputError
        If there is no such cluster, or it ends, or the folder cannot be created.
    """
    work = seen_by_all(work)
    with connected(address) as client:
        from distributed import as_completed

        left, asked, coming = iter(clips), dict[str, Clip](), as_completed(loop=client.loop)

        def submit(some: Iterator[Clip]) -> None:
            for clip in some:
                future = client.submit(do_on_worker, absolute(clip), work, max_memory, pure=False)
                asked[future.key] = clip
                coming.add(future)

        with _scheduler_errors(address):
            submit(islice(left, TASKS_AT_ONCE))
            for future in coming:
                yield _result_of(asked.pop(future.key), future, address)
                submit(islice(left, 1))


@contextmanager
def _scheduler_errors(address: str) -> Iterator[None]:
    """Turn the client's exceptions for a lost scheduler into one error."""
    try:
        yield
    except (OSError, TimeoutError, CancelledError) as error:
        raise _cluster_ended(address) from error


def _cluster_ended(address: str) -> InputError:
    message = "the Dask cluster ended; start it and run again, finished clips are kept"
    return InputError(message, code="worker-ended", path=address)


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """Yield a client of a cluster; tasks that are not done when the block ends are cancelled."""
    try:
        from distributed import Client
    except ImportError as error:
        raise MissingExtraError("clusters need the package distributed; run: pip install 'pdecodec[dask]'") from error
    place = {"address": address} if is_address(address) or not Path(address).is_file() else {"scheduler_file": address}
    try:
        client = Client(**place, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            "no Dask scheduler answers at this address; check it", code="unreadable", path=address
        ) from error
    with client:
        yield client


def do_on_worker(clip: Clip, work: Work, max_memory: int | None = None) -> Result:
    """Do one clip in a worker, in parallel with the clips of its other threads, within the memory that they share."""
    # A worker has one thread per processor that it may use, unless its environment sets another number.
    os.environ.setdefault("PDECODEC_THREADS", "1")
    if not is_address(work.folder) and not Path(work.folder, STATE_FOLDER).is_dir():
        message = "cannot be seen by a worker; choose a folder that all workers see under this name, or an address"
        return failure(clip, InputError(message, code="file-missing", path=work.folder))
    return do_clip(clip, work, _shared_budget(max_memory))


def _shared_budget(max_memory: int | None) -> MemoryBudget:
    """Return the budget shared by all clips that this process encodes under one limit."""
    with _budgets_lock:
        if max_memory not in _budgets:
            free = min(available_memory(), _worker_memory())
            _budgets[max_memory] = MemoryBudget(max_memory or int(AVAILABLE_SHARE * free))
        return _budgets[max_memory]


def _worker_memory() -> float:
    """Return the memory that this worker may take before it is ended [bytes]; infinite if there is no limit."""
    from distributed import get_worker

    try:
        return get_worker().memory_manager.memory_limit or float("inf")
    except (ValueError, AttributeError):  # not in a worker, or in one of another version
        return float("inf")


def absolute(clip: Clip) -> Clip:
    """Return the clip with absolute paths, which hold for every process."""

    def whole(path: str) -> str:
        return path if is_address(path) else os.path.abspath(path)

    mesh = clip.options.mesh
    options = clip.options if mesh is None else replace(clip.options, mesh=whole(mesh))
    return replace(clip, source=whole(clip.source), options=options)


def seen_by_all(work: Work) -> Work:
    """Return the work with an absolute path of its folder, which is created if missing."""
    if is_address(work.folder):
        return work
    folder = Path(os.path.abspath(work.folder))
    with write_errors(folder):
        (folder / STATE_FOLDER).mkdir(parents=True, exist_ok=True)
    return replace(work, folder=str(folder))


def _result_of(clip: Clip, future: Any, address: str) -> Result:
    if future.status == "cancelled":
        raise _cluster_ended(address)
    error = future.exception()
    if error is None:
        result: Result = future.result()
        return replace(result, source=clip.source)
    return failure(clip, _ours(error, clip))


def _ours(error: BaseException, clip: Clip) -> BaseException:
    """Return the error to report for a task that failed in the cluster."""
    from distributed import KilledWorker

    if isinstance(error, PdecodecError):
        return error
    if isinstance(error, KilledWorker):
        message = "several workers ended while encoding it; check whether it is damaged, or give workers more memory"
        return InputError(message, code="worker-ended", path=clip.source)
    if isinstance(error, ImportError):
        return InputError(
            f"a worker lacks this version of pdecodec ({error}); install it there",
            code="worker-ended",
            path=clip.source,
        )
    return error
