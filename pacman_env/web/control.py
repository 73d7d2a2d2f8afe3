"""Which person operates the game and has which role: one operator at a time, one person a role, one role a person."""

from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.web.game import Refused

KEPT_S = 10.0  # control and role of a person whose page is gone
DEAD_MAN_S = 0.5  # after the last velocity by hand the robot stands, as the Create 3 does
ROBOT = "robot"


def ghost_role(number: int) -> str:
    return f"ghost-{number}"


ROLES = (ROBOT, *map(ghost_role, range(len(GHOST_NAMES))))


class Roles:
    def __init__(self) -> None:
        self.people: dict[str, str] = {}  # by role

    def of(self, person: str) -> str | None:
        return next((role for role, other in self.people.items() if other == person), None)

    def require(self, person: str, role: str) -> None:
        if self.people.get(role) != person:
            raise Refused(f"the role {role} is not yours: choose it in the tab Play first")

    def assume(self, person: str, role: str) -> None:
        """Have a role instead of the present one; Refused if another person has it."""
        if self.people.get(role, person) != person:
            raise Refused(f"{self.people[role]} has the role {role}")
        self.leave(person)
        self.people[role] = person

    def leave(self, person: str) -> str | None:
        role = self.of(person)
        if role is not None:
            del self.people[role]
        return role

    def ghosts(self) -> dict[int, str]:
        return {k: self.people[role] for k in range(len(GHOST_NAMES)) if (role := ghost_role(k)) in self.people}


class Control:
    """The operator's lease and the roles. Times are of any clock, s."""

    def __init__(self) -> None:
        self.operator: str | None = None
        self.asking: list[str] = []  # in the order in which they asked
        self.roles = Roles()
        self.gone: dict[str, float] = {}  # since when, by person that control or a role is kept for

    def came(self, person: str) -> None:
        self.gone.pop(person, None)

    def went(self, person: str, now: float) -> None:
        if person in self.asking:
            self.asking.remove(person)
        if person == self.operator or self.roles.of(person) is not None:
            self.gone[person] = now

    def expire(self, now: float) -> list[str]:
        """Free what is kept for people that did not come back; returns them."""
        late = [person for person, since in self.gone.items() if now - since >= KEPT_S]
        for person in late:
            del self.gone[person]
            self.roles.leave(person)
            if person == self.operator:
                self._pass_to(None)
        return late

    def take(self, person: str) -> None:
        if self.operator not in (None, person):
            raise Refused(f"{self.operator} has control: ask for it")
        if self.operator is None:
            self._pass_to(person)

    def ask(self, person: str) -> None:
        """Show the operator that a person wants control; where there is no operator the person gets it."""
        if self.operator is None:
            self.take(person)
        elif person != self.operator and person not in self.asking:
            self.asking.append(person)

    def give(self, person: str) -> None:
        """Hand control to the first that asked; control is free if there is none."""
        if self.operator != person:
            raise Refused("you do not have control")
        self._pass_to(self.asking[0] if self.asking else None)

    def _pass_to(self, person: str | None) -> None:
        self.operator = person
        self.asking = [] if person is None else [other for other in self.asking if other != person]
