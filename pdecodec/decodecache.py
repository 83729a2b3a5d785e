"""Decoded segments or groups that are kept, the latest used ones, so that scrubbing does not decode one twice."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar


class _Sized(Protocol):
    @property
    def nbytes(self) -> int: ...


Item = TypeVar("Item", bound=_Sized)

CACHE_BYTES = 64 * 2**20
"""Memory for decoded segments or groups: all of most clips."""


class DecodeCache(Generic[Item]):
    """What was decoded, by index; at least the latest stays."""

    def __init__(self) -> None:
        self._items: OrderedDict[int, Item] = OrderedDict()
        self._bytes = 0

    def get(self, index: int, decode: Callable[[], Item]) -> Item:
        """The item of an index, decoded if it is not here."""
        if index in self._items:
            self._items.move_to_end(index)
            return self._items[index]
        item = self._items[index] = decode()
        self._bytes += item.nbytes
        while self._bytes > CACHE_BYTES and len(self._items) > 1:
            self._bytes -= self._items.popitem(last=False)[1].nbytes
        return item
