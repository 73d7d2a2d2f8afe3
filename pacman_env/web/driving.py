"""Which person plays what in the simulator, and what they order for the next tick."""

from __future__ import annotations

import time

from pacman_env.web import messages
from pacman_env.web.control import ROBOT, Roles, ghost_role
from pacman_env.web.game import Refused
from pacman_env.web.played_round import Orders, PlayedRound

_HAND_S = 0.5  # after so long without a velocity the robot stands (Create 3)


class Driving:
    """The roles, the goal of each, and the velocities by hand."""

    def __init__(self) -> None:
        self.roles = Roles()
        self.goals: dict[str, int | None] = {}  # candidates, by role
        self._hand: tuple[float, float, float] | None = None  # v, omega, when

    @property
    def plays_robot(self) -> bool:
        return ROBOT in self.roles.people

    def assume(self, person: str, role: str, ghosts: int) -> None:
        if role != ROBOT and role not in map(ghost_role, range(ghosts)):
            raise Refused(f"{role}: there are {ghosts} ghosts")
        self.roles.assume(person, role)
        self.goals[role] = None
        if not self.plays_robot:
            self._hand = None

    def leave(self, person: str) -> None:
        if self.roles.leave(person) == ROBOT:
            self._hand = None

    def steer(self, person: str, v: float, omega: float) -> None:
        """Velocities by hand, m/s and rad/s; at once, the newest counts."""
        self.roles.require(person, ROBOT)
        self._hand = (v, omega, time.monotonic())

    def release(self) -> None:
        self._hand = None

    def choose(self, person: str, goal: messages.Goal, played: PlayedRound) -> None:
        """Send the role of a person to a candidate, or to the one nearest to a place."""
        role = self.roles.of(person)
        if role is None:
            raise Refused("take a role first")
        candidate = goal.candidate
        if candidate is None:
            if goal.x is None or goal.y is None:
                raise Refused("goal: give a candidate, or x and y")
            candidate = played.nearest(goal.x, goal.y)
            if candidate is None:
                raise Refused("no pellet or refuge within 1 m")
        elif candidate > played.hold:
            raise Refused(f"candidate {candidate}: there are 0 to {played.hold}")
        self.goals[role] = None if candidate in (-1, played.hold) else candidate
        if role == ROBOT:
            self._hand = None

    def orders(self, played: PlayedRound) -> Orders:
        orders = Orders(robot=self.plays_robot, goal=self.goals.get(ROBOT))
        if orders.robot and self._hand is not None:
            v, omega, at_s = self._hand
            orders.velocity = (v, omega) if time.monotonic() - at_s < _HAND_S else (0.0, 0.0)
        playable = self.roles.ghosts().keys() & played.ghost_roles
        orders.ghosts = {number: self.goals.get(ghost_role(number)) for number in playable}
        return orders
