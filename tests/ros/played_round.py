"""A round of a whole game, with faults of the simulated robot, and what the goal selector reports."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pacman_env.ros import topics
from pacman_env.ros.simulated_robot.sim_robot import FAULT

if TYPE_CHECKING:
    from tests.ros.session import Session

SETTINGS = ("show.start_s=1.0", "show.death_s=1.0", "clyde.speed_mps=0.02")


class Played:
    """A round in the simulated robot's world, with faults."""

    def __init__(self, nodes: Session) -> None:
        self.nodes = nodes
        nodes.record(topics.GAME_STATE, topics.GAME_STATUS, topics.SCORE, topics.DIAGNOSTICS, topics.CMD_VEL)
        assert nodes.call(topics.START_GAME).success
        nodes.wait_for(lambda: "running" in nodes.values(topics.GAME_STATE), 60)
        self.wait(lambda c: c["goals_sent"] > 0, "a goal")

    @property
    def condition(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.nodes.values(topics.DIAGNOSTICS)[-1])
        return found

    def wait(self, holds: Callable[[dict[str, Any]], Any], what: str, limit_s: float = 60.0) -> dict[str, Any]:
        self.nodes.wait_for(lambda: holds(self.condition), limit_s, what)
        return self.condition

    def fault(self, text: str) -> None:
        self.nodes.publish(FAULT, text)
