"""Priority queue for searches on grids: integer keys in buckets, push and pop in constant time.

Among equal keys the newest entry comes first, which leads A* quickly to its goal.
"""

from typing import Any, NamedTuple

import numpy as np

from .arrays import Array
from .jit import kernel


class Queue(NamedTuple):
    heads: Any = Array(np.int32, "b")  # newest entry of each bucket
    stamps: Any = Array(np.int32, "b")  # number of the last ``clear`` before the head was written
    following: Any = Array(np.int32, "e")  # next entry of the same bucket
    items: Any = Array(np.int32, "e")
    state: Any = Array(np.int64, "4")


class SearchArrays(NamedTuple):
    nodes: Any = Array(np.int32, "k 4")
    queue: Any = Queue


_STAMP, _USED, _LOWEST, _WAITING = 0, 1, 2, 3
_LAST_STAMP = 2**31 - 1


def new_queue(keys: int, entries: int) -> Queue:
    """Return a queue for keys in [0, keys) and at most ``entries`` pushes between two clearings."""
    buckets, pushes = np.zeros((2, keys), np.int32), np.zeros((2, entries), np.int32)
    return Queue(buckets[0], buckets[1], pushes[0], pushes[1], np.zeros(4, np.int64))


@kernel
def clear(queue):  # type: ignore[no-untyped-def]
    """Empty the queue and return the number of clearings so far; after 2^31 - 1 (hours) it starts at 1 again."""
    state = queue.state
    if state[_STAMP] == _LAST_STAMP:
        queue.stamps[:] = 0
        state[_STAMP] = 0
    state[_STAMP] += 1
    state[_USED] = 0
    state[_LOWEST] = 0
    state[_WAITING] = 0
    return state[_STAMP]


@kernel
def push(queue, key, item):  # type: ignore[no-untyped-def]
    """Add an item (int32) and return True; return False if the queue is full or ``key`` is beyond its range."""
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
    """Remove and return an item with the lowest key, or return -1 if the queue is empty."""
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
