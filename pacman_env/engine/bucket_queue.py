"""A priority queue for searches on grids: integer keys in buckets, last in first out within a bucket.

Push and pop take constant time. Among equal keys the newest entry comes first, which lets A* dash towards its goal.
A queue is a tuple of arrays, made once by :func:`new_queue` and emptied in constant time before each search.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .jit import kernel

Queue = tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], NDArray[np.int64]]

_STAMP, _USED, _LOWEST, _WAITING = 0, 1, 2, 3
_LAST_STAMP = 2**31 - 1


def new_queue(keys: int, entries: int) -> Queue:
    """A queue for keys in [0, keys) and at most ``entries`` pushes between two clearings."""
    return (
        np.zeros(keys, dtype=np.int32),  # newest entry of each bucket
        np.zeros(keys, dtype=np.int32),  # the clearing that wrote it
        np.zeros(entries, dtype=np.int32),  # next entry of the same bucket
        np.zeros(entries, dtype=np.int32),  # the item
        np.zeros(4, dtype=np.int64),
    )


def queue_arrays(queue: Queue) -> dict[str, NDArray[Any]]:
    """The arrays of a queue by the names that they have in tables."""
    names = ("queue_heads", "queue_stamps", "queue_following", "queue_items", "queue_state")
    return dict(zip(names, queue, strict=True))


@kernel
def clear(queue):  # type: ignore[no-untyped-def]
    """Empty the queue; returns a number from 1 that grows with each clearing.

    After 2^31 - 1 of them, some hours of ghosts that search their ways, it is 1 again.
    """
    state = queue[4]
    if state[_STAMP] == _LAST_STAMP:
        queue[1][:] = 0
        state[_STAMP] = 0
    state[_STAMP] += 1
    state[_USED] = 0
    state[_LOWEST] = 0
    state[_WAITING] = 0
    return state[_STAMP]


@kernel
def push(queue, key, item):  # type: ignore[no-untyped-def]
    """Add an item; keys at or above the queue's range and entries beyond its room are dropped (False)."""
    head, stamp, following, items, state = queue
    entry = state[_USED]
    if key >= len(head) or entry >= len(items):
        return False
    following[entry] = head[key] if stamp[key] == state[_STAMP] else -1
    items[entry] = item
    head[key] = entry
    stamp[key] = state[_STAMP]
    state[_USED] = entry + 1
    state[_WAITING] += 1
    state[_LOWEST] = min(state[_LOWEST], key)
    return True


@kernel
def pop(queue):  # type: ignore[no-untyped-def]
    """Remove and return an item of the lowest key; -1: the queue is empty."""
    head, stamp, following, items, state = queue
    if state[_WAITING] == 0:
        return -1
    key = state[_LOWEST]
    while stamp[key] != state[_STAMP] or head[key] < 0:
        key += 1
    state[_LOWEST] = key
    entry = head[key]
    head[key] = following[entry]
    state[_WAITING] -= 1
    return items[entry]
