"""Assign control and roles to people: one operator at a time, one person per role, one role per person."""

from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.web.game_interface import Refused

#: A person whose page is gone keeps control and role for this time during a round. In the menu both are free at once,
#: but a person who returns within this time gets back what is still free.
KEPT_S = 10.0
DEAD_MAN_S = 0.5  # the robot stops this long after the last velocity command, like the Create 3
ROBOT = "robot"


def ghost_role(number: int) -> str:
    return f"ghost-{number}"


ROLES = (ROBOT, *map(ghost_role, range(len(GHOST_NAMES))))


class Roles:
    def __init__(self) -> None:
        self.people: dict[str, str] = {}

    def of(self, person: str) -> str | None:
        return next((role for role, other in self.people.items() if other == person), None)

    def require(self, person: str, role: str) -> None:
        if self.people.get(role) != person:
            raise Refused(f"the role {role} is not yours: choose it in the tab Play first")

    def assume(self, person: str, role: str) -> None:
        """Give a person a role instead of the present one; raises Refused if another person has it."""
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


class RoleControl:
    """Roles of the clients and the operator's control. Times come from any monotonic clock, s."""

    def __init__(self) -> None:
        self.operator: str | None = None
        self.asking: list[str] = []  # people who have requested control, in order
        self.roles = Roles()
        self.away: dict[str, tuple[float, bool, str | None]] = {}  # by person: when the page left (s), control, role

    def came(self, person: str) -> None:
        _, had_control, role = self.away.pop(person, (0.0, False, None))
        if had_control and self.operator is None:
            self._pass_to(person)
        if role is not None and role not in self.roles.people:
            self.roles.assume(person, role)

    def went(self, person: str, now: float) -> None:
        if person in self.asking:
            self.asking.remove(person)
        had_control, role = person == self.operator, self.roles.of(person)
        if had_control or role is not None:
            self.away[person] = now, had_control, role

    def expire(self, now: float, round_runs: bool) -> list[str]:
        """Free control and roles of people that are gone, and return the people that did not come back in time."""
        late = [person for person, (since, _, _) in self.away.items() if now - since >= KEPT_S]
        for person in late if round_runs else self.away:
            self.roles.leave(person)
            if person == self.operator:
                self._pass_to(None)
        for person in late:
            del self.away[person]
        return late

    def take(self, person: str) -> None:
        if self.operator not in (None, person):
            raise Refused(f"{self.operator} has control: ask for it")
        self._pass_to(person)

    def ask(self, person: str) -> None:
        """Request control for a person, who gets it at once if there is no operator."""
        if self.operator is None:
            self.take(person)
        elif person != self.operator and person not in self.asking:
            self.asking.append(person)

    def give(self, person: str) -> None:
        """Pass control to the first person who asked, or free it if no person asked."""
        if self.operator != person:
            raise Refused("you do not have control")
        self._pass_to(self.asking[0] if self.asking else None)

    def keep(self, person: str) -> None:
        """Refuse control to all people who asked."""
        if self.operator != person:
            raise Refused("you do not have control")
        self.asking.clear()

    def _pass_to(self, person: str | None) -> None:
        self.operator = person
        self.asking = [] if person is None else [other for other in self.asking if other != person]
