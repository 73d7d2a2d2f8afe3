"""Queue of tasks for workers; taking a task takes constant time."""

import math
from collections import deque
from collections.abc import Hashable, Sequence

Worker = Hashable


class Queue:
    """Queue that assigns tasks with the same key (home) to the same worker, which may have cached data for them.

    Homes are distributed evenly over the workers; homes of a lost worker go to others. Without homes each task is its
    own home.
    """

    def __init__(self, count: int, homes: Sequence[Hashable] | None, owners: dict[Hashable, Worker]) -> None:
        """Queue ``count`` tasks; ``owners`` is the worker of each home of the last run, and is updated in place."""
        self._homes: Sequence[Hashable] = range(count) if homes is None else homes
        self._count = count
        self._waiting: dict[Hashable, deque[int]] = {}  # tasks by home
        for number in range(count):
            self._waiting.setdefault(self._homes[number], deque()).append(number)
        if homes is None:
            owners.clear()
        for home in owners.keys() - self._waiting.keys():
            del owners[home]
        self._owners = owners
        self._of: dict[Worker, dict[Hashable, None]] = {}  # homes by worker, in order
        for home, worker in owners.items():
            self._of.setdefault(worker, {})[home] = None
        self._free = deque(home for home in self._waiting if home not in owners)
        self._keeps = homes is not None

    def __len__(self) -> int:
        return self._count

    @property
    def free(self) -> int:
        """Number of unassigned homes with waiting tasks, which are all that an idle worker can get."""
        return len(self._free)

    def take(self, worker: Worker, workers: int) -> int | None:
        """Return the next task for one of ``workers`` workers, or None if the waiting tasks belong to others."""
        own = self._of.setdefault(worker, {})
        most = math.ceil(len(self._waiting) / max(workers, 1))
        while self._keeps and len(own) > most:
            self._release(own.popitem()[0])
        home = next((home for home in own if self._waiting[home]), None)
        if home is None and self._free and (len(own) < most or not self._keeps):
            home = self._free.popleft()
            if self._keeps:
                own[home], self._owners[home] = None, worker
        if home is None:
            return None
        self._count -= 1
        return self._waiting[home].popleft()

    def put_back(self, number: int) -> None:
        """Put a taken task back to the front of its home's queue."""
        home = self._homes[number]
        if home not in self._owners and not self._waiting[home]:
            self._free.appendleft(home)
        self._waiting[home].appendleft(number)
        self._count += 1

    def lose(self, worker: Worker) -> None:
        """Release the homes of a worker that was lost or has lost its cached data."""
        for home in self._of.pop(worker, {}):
            self._release(home)

    def _release(self, home: Hashable) -> None:
        del self._owners[home]
        if self._waiting[home]:
            self._free.append(home)
