"""Tasks that wait for a worker; taking one costs the same however many there are."""

import math
from collections import deque
from collections.abc import Hashable, Sequence

Worker = Hashable


class Queue:
    """Tasks of one home go to the worker that has done the home's task before, which may have kept what it needs.

    Homes are shared evenly over the workers; those of a worker that is lost go to others. Without homes each task is
    one of its own.
    """

    def __init__(self, count: int, homes: Sequence[Hashable] | None, owners: dict[Hashable, Worker]) -> None:
        """``owners``: the worker of each home, from the run before, and from now on of this one."""
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
        self._of: dict[Worker, dict[Hashable, None]] = {}  # homes by worker, in their order
        for home, worker in owners.items():
            self._of.setdefault(worker, {})[home] = None
        self._free = deque(home for home in self._waiting if home not in owners)
        self._keeps = homes is not None

    def __len__(self) -> int:
        return self._count

    @property
    def free(self) -> int:
        """Homes that no worker has and whose tasks wait: for a worker that got none there is nothing else to come."""
        return len(self._free)

    def take(self, worker: Worker, workers: int) -> int | None:
        """The task that one of so many workers does next; None: what is waiting is for others."""
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
        """A task that was taken waits again, first of its home."""
        home = self._homes[number]
        if home not in self._owners and not self._waiting[home]:
            self._free.appendleft(home)
        self._waiting[home].appendleft(number)
        self._count += 1

    def lose(self, worker: Worker) -> None:
        """A worker is there no more, or has forgotten everything."""
        for home in self._of.pop(worker, {}):
            self._release(home)

    def _release(self, home: Hashable) -> None:
        del self._owners[home]
        if self._waiting[home]:
            self._free.append(home)
