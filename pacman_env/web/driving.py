"""Goals that people give the robot and the ghosts of a simulated game: roles, clicks on the map, velocities by hand."""

import time

from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.web import page_messages
from pacman_env.web.game_interface import Refused
from pacman_env.web.orders import FOLLOW, Orders
from pacman_env.web.played_round import PlayedRound
from pacman_env.web.roles import DEAD_MAN_S, ROBOT, Roles, ghost_role


class Driving:
    def __init__(self) -> None:
        self.roles = Roles()
        self.goals: dict[str, int | None] = {}  # goals by role: the robot's candidate, a ghost's cell or FOLLOW
        self.hand: tuple[float, float, float] | None = None  # v (m/s), omega (rad/s) by hand, and when (s)

    @property
    def plays_robot(self) -> bool:
        return ROBOT in self.roles.people

    def assume(self, person: str, role: str, ghosts: int) -> None:
        if role != ROBOT and role not in map(ghost_role, range(ghosts)):
            raise Refused(f"{role}: there are {ghosts} ghosts")
        self.roles.assume(person, role)
        self.goals[role] = None
        if role == ROBOT:
            self.hand = None

    def steer(self, person: str, v: float, omega: float) -> None:
        self.roles.require(person, ROBOT)
        self.hand = (v, omega, time.monotonic())

    def choose(self, person: str, goal: page_messages.Goal, played: PlayedRound) -> None:
        role = self.roles.of(person)
        if role is None:
            raise Refused("choose a role in the tab Play first")
        if goal.candidate is not None and goal.candidate > played.hold:
            raise Refused(f"candidate {goal.candidate}: must be 0 to {played.hold}")
        if role == ROBOT:
            self.goals[role] = _robot_goal(goal, played)
            self.hand = None
        else:
            number = next(k for k, player in self.roles.ghosts().items() if player == person)
            self.goals[role] = _ghost_goal(number, goal, played)

    def sent(self, played: PlayedRound) -> dict[int, int | None]:
        """Return the cell (or FOLLOW, or None) to which a person sends each played ghost, by the ghost's number."""
        playable = self.roles.ghosts().keys() & played.ghost_roles
        return {number: self.goals.get(ghost_role(number)) for number in playable}

    def orders(self, played: PlayedRound) -> Orders:
        orders = Orders(robot=self.plays_robot, goal=self.goals.get(ROBOT), ghosts=self.sent(played))
        if orders.robot and self.hand is not None:
            v, omega, at_s = self.hand
            orders.velocity = (v, omega) if time.monotonic() - at_s < DEAD_MAN_S else (0.0, 0.0)
        return orders


def _robot_goal(goal: page_messages.Goal, played: PlayedRound) -> int | None:
    """Return the robot's candidate, or None to hold. Raises Refused for a goal without a candidate nearby."""
    candidate = goal.candidate
    if candidate is None:
        if goal.x is None or goal.y is None:
            raise Refused("goal: give a candidate, or x and y")
        candidate = played.nearest(goal.x, goal.y)
        if candidate is None:
            raise Refused("no pellet or refuge within 1 m")
    return None if candidate in (-1, played.hold) else candidate


def _ghost_goal(number: int, goal: page_messages.Goal, played: PlayedRound) -> int | None:
    """Return a ghost's cell, FOLLOW, or None for its configured behaviour. Raises Refused for an unsuitable goal."""
    if number not in played.ghost_roles:
        raise Refused(f"{GHOST_NAMES[number].capitalize()} is yours from the next round on")
    if goal.follow:
        return FOLLOW
    if goal.candidate in (-1, played.hold):
        return None
    x, y = (goal.x, goal.y) if goal.candidate is None else played.assets.goal_xy[goal.candidate].tolist()
    if x is None or y is None:
        raise Refused("goal: give a candidate, x and y, or follow")
    return played.nearest_ghost_cell(number, x, y)
