"""Who plays whom in the simulator, and what they want of the next tick."""

from __future__ import annotations

import time

from pacman_env.web import messages
from pacman_env.web.game import Refused
from pacman_env.web.played_round import Orders, PlayedRound
from pacman_env.web.roles import ROBOT, Roles, ghost_role

_HAND_S = 0.5  # after so long without a velocity the robot stands (Create 3)


class Driving:
    """The roles, the goal of each, and the velocities by hand."""

    def __init__(self) -> None:
        self.roles = Roles()
        self._goals: dict[str, int | None] = {}  # by role
        self._hand: tuple[float, float, float] | None = None  # v, omega, when

    @property
    def plays_robot(self) -> bool:
        """Whether a person plays the robot."""
        return self.roles.person(ROBOT) is not None

    def assume(self, person: str, role: str, ghosts: int) -> None:
        """Have a role of a game with so many ghosts.

        Raises:
            Refused: there is no such ghost, or another person has the role.
        """
        if role != ROBOT and role not in map(ghost_role, range(ghosts)):
            raise Refused(f"{role}: there are {ghosts} ghosts")
        self.roles.assume(person, role)
        self._goals[role] = None
        if not self.plays_robot:
            self._hand = None

    def leave(self, person: str) -> None:
        """A person's role is free."""
        if self.roles.leave(person) == ROBOT:
            self._hand = None

    def steer(self, person: str, v: float, omega: float) -> None:
        """Velocities by hand, m/s and rad/s; at once, the newest counts."""
        self.roles.require(person, ROBOT)
        self._hand = (v, omega, time.monotonic())

    def let_go(self) -> None:
        """Nobody steers."""
        self._hand = None

    def choose(self, person: str, goal: messages.Goal, played: PlayedRound) -> None:
        """Send whom the person plays to a candidate, or to the one nearest to a place.

        Raises:
            Refused: no role, no such candidate.
        """
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
        self._goals[role] = None if candidate in (-1, played.hold) else candidate
        if role == ROBOT:
            self._hand = None

    def forget_goals(self) -> None:
        """Another round: nobody is sent anywhere yet."""
        self._goals.clear()

    def orders(self, played: PlayedRound) -> Orders:
        """For the next tick of a round."""
        orders = Orders(robot=self.plays_robot, goal=self._goals.get(ROBOT))
        if orders.robot and self._hand is not None:
            v, omega, at_s = self._hand
            orders.velocity = (v, omega) if time.monotonic() - at_s < _HAND_S else (0.0, 0.0)
        for number in self.roles.ghosts():
            if number in played.ghost_roles:
                orders.ghosts[number] = self._goals.get(ghost_role(number))
        return orders
