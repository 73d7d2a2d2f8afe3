"""Who runs the game and who plays whom: one operator at a time, one person a role. No clock and no connection here."""

from __future__ import annotations

from pacman_env.web.game import Refused
from pacman_env.web.roles import Roles

KEPT_S = 10.0  # control and role of somebody whose page is gone


class Control:
    """The operator's lease and the roles. Times are of any clock, in s."""

    def __init__(self) -> None:
        self.operator: str | None = None
        self.asking: list[str] = []  # in the order in which they asked
        self.roles = Roles()
        self._gone: dict[str, float] = {}  # since when, by person

    def came(self, person: str) -> None:
        """A person is here, or here again."""
        self._gone.pop(person, None)

    def went(self, person: str, now: float) -> None:
        """His page is gone: what he has is kept for a while."""
        if person in self.asking:
            self.asking.remove(person)
        if person == self.operator or self.roles.of(person) is not None:
            self._gone[person] = now

    def expire(self, now: float) -> list[str]:
        """Take from those who did not come back what they had.

        Returns:
            Who they are.
        """
        late = [person for person, since in self._gone.items() if now - since >= KEPT_S]
        for person in late:
            del self._gone[person]
            self.roles.leave(person)
            if person == self.operator:
                self._pass_to(None)
        return late

    def is_gone(self, person: str) -> bool:
        """Whether something is kept for a person who is not here."""
        return person in self._gone

    def take(self, person: str) -> None:
        """Have control from now on.

        Raises:
            Refused: another has it.
        """
        if self.operator not in (None, person):
            raise Refused(f"{self.operator} has control: ask for it")
        if self.operator is None:
            self._pass_to(person)

    def ask(self, person: str) -> None:
        """Let who has control see that a person wants it; where nobody has it he takes it."""
        if self.operator is None:
            self.take(person)
        elif person != self.operator and person not in self.asking:
            self.asking.append(person)

    def give(self, person: str) -> None:
        """Hand control to who asked first, or to nobody.

        Raises:
            Refused: he does not have it.
        """
        if self.operator != person:
            raise Refused("you do not have control")
        self._pass_to(self.asking[0] if self.asking else None)

    def _pass_to(self, person: str | None) -> None:
        self.operator = person
        self.asking = [] if person is None else [who for who in self.asking if who != person]
