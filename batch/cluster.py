"""A batch on many machines: clips as tasks of a Dask cluster, whose workers see the same folders and addresses."""

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
"""Until a scheduler that does not answer is one that is not there."""

TASKS_AT_ONCE = 10_000
"""That the scheduler knows of: more than a cluster does in a minute, and few enough for it to stay quick."""

_budgets: dict[int | None, MemoryBudget] = {}
_budgets_lock = Lock()


def run_on_cluster(
    clips: Sequence[Clip], work: Work, address: str, *, max_memory: int | None = None
) -> Iterator[Result]:
    """Make every clip that is not done, on the workers of a Dask cluster; results as clips are done with.

    What a worker was doing when it ended is done by another one; the record of a clip tells what was done already. A
    clip on which several workers end is one that failed.

    Parameters
    ----------
    clips : sequence of Clip
    work : Work
        Its folder, and paths of clips, are to be on storage that the workers see under the same names.
    address : str
        Of the scheduler (``tcp://host:8786``), or the path of its scheduler file.
    max_memory : int, optional [bytes]
        What clips coded at once in one worker process may take together, by estimate. Default: most of the memory that
        the worker may take, and is free.

    Raises
    ------
    MissingExtraError
        If the extra ``dask`` is not installed.
    InputError
        If there is no such cluster, or it ends, or the folder cannot be made.
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
    """Turn what the client raises without a scheduler into one line."""
    try:
        yield
    except (OSError, TimeoutError, CancelledError) as error:
        raise _cluster_ended(address) from error


def _cluster_ended(address: str) -> InputError:
    message = "the Dask cluster ended; start it and run again, what is done is kept"
    return InputError(message, code="worker-ended", path=address)


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """A client of a cluster; what it was asked for and is not done when the block ends is not done any more."""
    try:
        from distributed import Client
    except ImportError as error:
        raise MissingExtraError("clusters need the package distributed; run: pip install 'pdecodec[dask]'") from error
    place = {"address": address} if is_address(address) or not Path(address).is_file() else {"scheduler_file": address}
    try:
        client = Client(**place, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            "no Dask scheduler answers there; check the address", code="unreadable", path=address
        ) from error
    with client:
        yield client


def do_on_worker(clip: Clip, work: Work, max_memory: int | None = None) -> Result:
    """What becomes of a clip, in a worker: beside others of its threads, within the memory that they share."""
    # A worker has a thread for each processor that it may use, unless its environment says otherwise.
    os.environ.setdefault("PDECODEC_THREADS", "1")
    if not is_address(work.folder) and not Path(work.folder, STATE_FOLDER).is_dir():
        message = "is not seen by a worker; take a folder that all of them see under this name, or an address"
        return failure(clip, InputError(message, code="file-missing", path=work.folder))
    return do_clip(clip, work, _shared_budget(max_memory))


def _shared_budget(max_memory: int | None) -> MemoryBudget:
    """What the clips share that this process codes under one limit, for as long as it lives."""
    with _budgets_lock:
        if max_memory not in _budgets:
            free = min(available_memory(), _worker_memory())
            _budgets[max_memory] = MemoryBudget(max_memory or int(AVAILABLE_SHARE * free))
        return _budgets[max_memory]


def _worker_memory() -> float:
    """Bytes that this worker may take before it is ended; infinite where nobody says."""
    from distributed import get_worker

    try:
        return get_worker().memory_manager.memory_limit or float("inf")
    except (ValueError, AttributeError):  # not in a worker, or in one of another version
        return float("inf")


def absolute(clip: Clip) -> Clip:
    """The clip with paths that do not depend on the folder that a process is in."""

    def whole(path: str) -> str:
        return path if is_address(path) else os.path.abspath(path)

    mesh = clip.options.mesh
    options = clip.options if mesh is None else replace(clip.options, mesh=whole(mesh))
    return replace(clip, source=whole(clip.source), options=options)


def seen_by_all(work: Work) -> Work:
    """The work with a folder that does not depend on where a process is, and that is there."""
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
    """What the cluster says of a task that did not come back, in a line of ours."""
    from distributed import KilledWorker

    if isinstance(error, PdecodecError):
        return error
    if isinstance(error, KilledWorker):
        message = "workers ended on it, again and again; see whether it is damaged, or give workers more memory"
        return InputError(message, code="worker-ended", path=clip.source)
    if isinstance(error, ImportError):
        return InputError(
            f"a worker has no pdecodec as it is here ({error}); install it there", code="worker-ended", path=clip.source
        )
    return error
