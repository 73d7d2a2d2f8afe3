"""What the robot's side has reported to the referee without hearing that it was taken in, to be said once more.

The referee may be away for a while: what is said to nobody is lost. That he ignores what he has heard before is
``round.py``'s rule; when something is reported at all is decided in ``goal_executor.py``.
"""

from __future__ import annotations


class UnacknowledgedStatuses:
    """Statuses and their answers: a pellet is answered by the count of pellets, an end by what the game does next."""

    def __init__(self) -> None:
        self.end = ""  # what ended the task, empty once it was answered
        self.pellets: list[str] = []  # reported, not counted yet
        self._counted: int | None = None  # pellets of the round, as the game counts them; None: nobody has said
        self._expected = 0  # what that comes to when every pellet was heard of
        self._asked: set[str] = set()  # open at the last call of ``open``
        self._earlier = 0  # of the pellets, those that were reported before the event that is looked at now

    def look(self) -> None:
        """Another event begins: pellets that are unanswered by now may have been lost on the way."""
        self._earlier = 0 if self._counted is None else len(self.pellets)

    def ended(self, word: str) -> list[str]:
        """Report the end of a task; returns the statuses: no pellet may come after the end, for it would not count."""
        self.end = word
        return [*self.pellets[: self._earlier], word]

    def withdraw(self, word: str) -> None:
        """That end was none after all."""
        if self.end == word:
            self.end = ""

    def collected(self, pellet: int) -> str:
        """Report a pellet; returns the status."""
        word = f"pellet_collected:{pellet}"
        self.pellets.append(word)
        self._expected = max(self._expected, self._counted or 0) + 1
        return word

    def counted(self, count: int) -> None:
        """How many pellets of this round the game has counted, those of an executing side before this one included."""
        self._counted = count
        if count >= self._expected:
            self._forget()

    def new_state(self) -> None:
        """The game has gone on to another state: what was reported in the one before is answered, or too late."""
        self.end = ""
        self._forget()

    def new_round(self) -> None:
        """Counting begins again."""
        self._forget()
        self._expected = 0

    def open(self) -> list[str]:
        """What was unanswered at the last call already; to be called every few seconds.

        Nothing is missed of a game that does not count, for it would never answer.
        """
        now = ([] if self._counted is None else self.pellets) + ([self.end] if self.end else [])
        again = [word for word in now if word in self._asked]
        self._asked = set(now)
        return again

    def _forget(self) -> None:
        self.pellets.clear()
        self._earlier = 0
