"""Statuses that the referee has not acknowledged, to be reported again: it may be away for a while.

That the referee ignores what it has received before is ``round.py``'s rule; when something is reported is decided in
``goal_executor.py``.
"""

from __future__ import annotations

from .goals import ExecutorAction


class UnacknowledgedStatuses:
    """A pellet is acknowledged by the count of pellets, an end by what the game does next."""

    def __init__(self) -> None:
        self.end = ""  # what ended the task, empty once it was acknowledged
        self.pellets: list[str] = []  # reported, not counted yet
        self._counted: int | None = None  # pellets of the round by the game's count; None if not received
        self._expected = 0  # the count once every report was received
        self._open_before: set[str] = set()  # at the last call of ``open``
        self._earlier = 0  # of the pellets, those that were reported before the present event

    def begin_event(self) -> None:
        """Pellets that are unacknowledged by now may have been lost in transit."""
        self._earlier = 0 if self._counted is None else len(self.pellets)

    def ended(self, word: str) -> list[ExecutorAction]:
        """Report the end of a task, after earlier pellets: a pellet after the end would not count."""
        self.end = word
        return [ExecutorAction("status", one) for one in (*self.pellets[: self._earlier], word)]

    def withdraw(self, word: str) -> None:
        """The task has not ended after all."""
        if self.end == word:
            self.end = ""

    def collected(self, pellet: int) -> ExecutorAction:
        """Report a pellet."""
        self.pellets.append(f"pellet_collected:{pellet}")
        self._expected = max(self._expected, self._counted or 0) + 1
        return ExecutorAction("status", self.pellets[-1])

    def counted(self, count: int) -> None:
        """The game's count of this round's pellets, including those of an executing side before this one."""
        self._counted = count
        if count >= self._expected:
            self._forget()

    def new_state(self) -> None:
        """What was reported in the state before is acknowledged, or too late."""
        self.end = ""
        self._forget()

    def new_round(self) -> None:
        """The count begins again."""
        self._forget()
        self._expected = 0

    def open(self) -> list[str]:
        """What was unacknowledged at the last call already; to be called every few seconds.

        Of a game that does not count, pellets are never reported again: it would never acknowledge them.
        """
        now = ([] if self._counted is None else self.pellets) + ([self.end] if self.end else [])
        again = [word for word in now if word in self._open_before]
        self._open_before = set(now)
        return again

    def _forget(self) -> None:
        self.pellets.clear()
        self._earlier = 0
