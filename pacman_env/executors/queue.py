"""The queue that hands out tasks to workers: tasks with the same key go to the same worker."""

import math
from collections import deque
from collections.abc import Hashable, Sequence

Worker = Hashable


class StickyQueue:
    """Tasks that wait for a worker; handing one out costs the same however many wait.

    Tasks with the same key go to the worker that did the last task of this key, because it may have kept data. Keys are
    shared evenly over the workers, and the keys of a lost worker go to others. Without keys any worker does any task.
    """

    def __init__(self, count: int, keys: Sequence[Hashable] | None, owners: dict[Hashable, Worker]) -> None:
        """Queue the tasks of a run; ``owners``, the worker of each key in earlier runs, is updated."""
        self._has_keys = keys is not None
        self._key_of: Sequence[Hashable] = range(count) if keys is None else keys
        self._count = count
        self._waiting: dict[Hashable, deque[int]] = {}  # numbers of tasks by key
        for number in range(count):
            self._waiting.setdefault(self._key_of[number], deque()).append(number)
        for key in [key for key in owners if keys is None or key not in self._waiting]:
            del owners[key]
        self._owners = owners
        self._keys_of: dict[Worker, dict[Hashable, None]] = {}  # by worker, in the order in which it got them
        for key, worker in owners.items():
            self._keys_of.setdefault(worker, {})[key] = None
        self._unassigned = deque(key for key in self._waiting if key not in owners)

    def __len__(self) -> int:
        return self._count

    @property
    def unassigned(self) -> int:
        """Number of keys with waiting tasks that belong to no worker; a new worker can get only these."""
        return len(self._unassigned)

    def next_task(self, worker: Worker, workers: int) -> int | None:
        """Return the next task for ``worker``, one of ``workers``; None if the waiting tasks belong to others."""
        own = self._keys_of.setdefault(worker, {})
        share = math.ceil(len(self._waiting) / max(workers, 1))
        while self._has_keys and len(own) > share:
            self._unassign(own.popitem()[0])
        key = next((key for key in own if self._waiting[key]), None)
        if key is None and self._unassigned and (len(own) < share or not self._has_keys):
            key = self._unassigned.popleft()
            if self._has_keys:
                own[key], self._owners[key] = None, worker
        if key is None:
            return None
        self._count -= 1
        return self._waiting[key].popleft()

    def retry(self, number: int) -> None:
        """Put a task back in front of the others with its key."""
        key = self._key_of[number]
        if key not in self._owners and not self._waiting[key]:
            self._unassigned.appendleft(key)
        self._waiting[key].appendleft(number)
        self._count += 1

    def drop_worker(self, worker: Worker) -> None:
        """Give the keys of a worker that is lost, or that has lost its data, to other workers."""
        for key in self._keys_of.pop(worker, {}):
            self._unassign(key)

    def _unassign(self, key: Hashable) -> None:
        del self._owners[key]
        if self._waiting[key]:
            self._unassigned.append(key)
