"""Compiled sets of numbers below n that know how many of their members lie below a number, and which is the k-th.

A binary indexed tree (Fenwick 1994, "A new data structure for cumulative frequency tables"): each operation takes
a number of steps that grows with the logarithm of n.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.uncounted import uncounted

Int32Array = NDArray[np.int32]


def full_set(size: int) -> Int32Array:
    """All numbers below `size`: (size + 1,) int32."""
    places = np.arange(size + 1, dtype=np.int32)
    return places & -places


def empty_set(size: int) -> Int32Array:
    """No number, with room for those below `size`: (size + 1,) int32."""
    return np.zeros(size + 1, np.int32)


@uncounted
def include(tree: Int32Array, number: int, change: int) -> None:
    """Add a number that is not in the set (`change` 1), or take out one that is (-1)."""
    place = number + 1
    while place < tree.size:
        tree[place] += change
        place += place & -place


@uncounted
def rank_of(tree: Int32Array, number: int) -> int:
    """How many members are below `number`."""
    count = 0
    place = number
    while place > 0:
        count += tree[place]
        place -= place & -place
    return count


@uncounted
def member_at(tree: Int32Array, rank: int) -> int:
    """The member that has `rank` members below it, 0 to the number of members less 1."""
    place = 0
    step = 1
    while 2 * step < tree.size:
        step *= 2
    while step > 0:
        if place + step < tree.size and tree[place + step] <= rank:
            place += step
            rank -= tree[place]
        step //= 2
    return place
