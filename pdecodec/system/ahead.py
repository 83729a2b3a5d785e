"""Compute results ahead in another thread, while the calling thread continues."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any, Generic, TypeVar

from pdecodec.system.shares import MIN_SHARED_SIZE

Key = TypeVar("Key", bound=Hashable)
Result = TypeVar("Result")


class _AtOnce(Executor):
    """Executor that runs each call at once, in the same thread."""

    def submit(self, work: Callable[..., Result], /, *arguments: Any, **named: Any) -> Future[Result]:
        done: Future[Result] = Future()
        try:
            done.set_result(work(*arguments, **named))
        except Exception as error:  # Raised when the result is requested, as with a thread.
            done.set_exception(error)
        return done


def thread_ahead(size: int) -> Executor:
    """Return a thread that computes ahead, or a substitute that computes at once if the clip is so small, in
    vertices times frames, that starting a thread takes longer than the work.
    """
    return _AtOnce() if size < MIN_SHARED_SIZE else ThreadPoolExecutor(1)


class MadeAhead(Generic[Key, Result]):
    """Cache of results, each made once: ahead in another thread, or when it is first requested."""

    def __init__(self, make: Callable[[Key], Result], ahead: Executor) -> None:
        self._make, self._ahead = make, ahead
        self._made: dict[Key, Future[Result]] = {}

    def begin(self, *keys: Key) -> None:
        """Start making results in the other thread."""
        for key in keys:
            if key not in self._made:
                self._made[key] = self._ahead.submit(self._make, key)

    def get(self, key: Key) -> Result:
        """Return a result, made in this thread if it was not begun."""
        if key not in self._made:
            made: Future[Result] = Future()
            made.set_result(self._make(key))
            self._made[key] = made  # Only now, so that no other thread waits for a result that failed.
        return self._made[key].result()
