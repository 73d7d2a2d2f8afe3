"""Who plays whom: the robot and each ghost are a role, and a role is one person's."""

from __future__ import annotations

from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.web.game import Refused

ROBOT = "robot"


def ghost_role(number: int) -> str:
    """The role of a ghost."""
    return f"ghost-{number}"


ROLES = (ROBOT, *map(ghost_role, range(len(GHOST_NAMES))))


class Roles:
    """The roles that are taken; a person has one at most."""

    def __init__(self) -> None:
        self.people: dict[str, str] = {}  # by role

    def person(self, role: str) -> str | None:
        """Who has a role."""
        return self.people.get(role)

    def of(self, person: str) -> str | None:
        """The role that a person has."""
        return next((role for role, who in self.people.items() if who == person), None)

    def require(self, person: str, role: str) -> None:
        """Raise Refused unless the person has the role."""
        if self.people.get(role) != person:
            raise Refused(f"the role {role} is not yours: take it first")

    def assume(self, person: str, role: str) -> None:
        """Have a role, instead of the one that the person has.

        Raises:
            Refused: another person has it.
        """
        if self.people.get(role, person) != person:
            raise Refused(f"{self.people[role]} has the role {role}")
        self.leave(person)
        self.people[role] = person

    def leave(self, person: str) -> str | None:
        """Have no role; returns the one that the person had."""
        role = self.of(person)
        if role is not None:
            del self.people[role]
        return role

    def ghosts(self) -> dict[int, str]:
        """Who plays which ghost, by the ghost's number."""
        return {number: who for number in range(len(GHOST_NAMES)) if (who := self.people.get(ghost_role(number)))}
