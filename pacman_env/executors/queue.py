"""Tasks that wait for a worker."""

import math
from collections import Counter, deque
from collections.abc import Hashable, Sequence

Worker = Hashable


class Queue:
    """Tasks of one home go to the worker that has done the home's task before, which may have kept what it needs.

    Homes are shared evenly over the workers; those of a worker that is lost go to others.
    """

    def __init__(self, count: int, homes: Sequence[Hashable] | None, owners: dict[Hashable, Worker]) -> None:
        """``owners``: the worker of each home, from the run before, and from now on of this one."""
        self._waiting, self._homes, self._owners = deque(range(count)), homes, owners
        different = set(homes or ())
        for home in owners.keys() - different:
            del owners[home]
        self._count = len(different)

    def __len__(self) -> int:
        return len(self._waiting)

    def take(self, worker: Worker, workers: int) -> int | None:
        """The task that one of so many workers does next; None: what is waiting is for others."""
        if self._homes is None:
            return self._waiting.popleft() if self._waiting else None
        owners, most = self._owners, math.ceil(self._count / max(workers, 1))
        for home in [home for home, owner in owners.items() if owner == worker][most:]:
            del owners[home]
        room = Counter(owners.values())[worker] < most
        chosen = next((n for n in self._waiting if owners.get(self._homes[n]) == worker), None)
        if chosen is None and room:
            chosen = next((n for n in self._waiting if self._homes[n] not in owners), None)
        if chosen is not None:
            self._waiting.remove(chosen)
            owners[self._homes[chosen]] = worker
        return chosen

    def put_back(self, number: int) -> None:
        """A task that was taken waits again, first of all."""
        self._waiting.appendleft(number)

    def lose(self, worker: Worker) -> None:
        """A worker is there no more, or has forgotten everything."""
        for home in [home for home, owner in self._owners.items() if owner == worker]:
            del self._owners[home]
