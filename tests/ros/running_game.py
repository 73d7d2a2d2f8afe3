"""A whole game in lock-step that tests bring to where they need it, and whose nodes they kill and start again."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from pacman_env.ros import topics
from pacman_env.ros.messages import pose_message, pose_of
from pacman_env.ros.simulated_robot.sim_robot import FAULT
from pacman_env.ros.supervisor.game_nodes import REFEREE, SELECTOR
from tests.ros.session import Session

FAR_M = 3.0  # from home
CLYDE_MPS = 0.02  # a robot that stands for as long as its planner is away is not caught meanwhile
SETTINGS = (f"clyde.speed_mps={CLYDE_MPS}", "show.start_s=4", "show.death_s=5")
HOME = 0.0, 0.0, 0.0  # the map's
POLICY = "lookahead"  # not clyde_aware, whose rounds Clyde ends too often
RECORDED = (
    *(topics.GAME_STATE, topics.GAME_RESULT, topics.SCORE, topics.ROUND, topics.PELLETS_SPAWNED),
    *(topics.PELLETS_COLLECTED, topics.CLYDE_SPEED, topics.GAME_COMMAND, topics.GAME_EVENT, topics.GAME_STATUS),
    *(topics.GAME_LIGHT, topics.PELLET_MARKERS, topics.REMOVE_PELLET, topics.CLYDE_POSE, topics.AMCL_POSE),
    *(topics.ODOMETRY, topics.CMD_VEL),
)


class Game:
    """All nodes but the operator, which is the test.

    Args:
        session: of a whole game.
        map: its map, as ``map_yaml`` takes it.
    """

    def __init__(self, session: Session, map: str) -> None:
        self.session = session
        self._own: dict[str, dict[str, Any]] = {
            "pellet_manager": {"map_yaml": map},
            "clyde_ghost_node": {"map_yaml": map},
            SELECTOR: {"map_yaml": map, "policy": POLICY, "home": list(HOME)},
        }
        session.record(*RECORDED)
        seen = (topics.PELLET_MARKERS, topics.CLYDE_POSE, topics.AMCL_POSE, topics.ODOMETRY)
        self.wait(lambda: all(self.latest(topic) is not None for topic in seen), "pellets, Clyde and the robot")

    def start(self, name: str, *left_out: str) -> None:
        """Start a node with its parameters but some."""
        own = {key: value for key, value in self._own.get(name, {}).items() if key not in left_out}
        self.session.start(name, settings=list(SETTINGS), **own)

    def wait(self, condition: Callable[[], Any], what: str, limit_s: float = 300.0) -> Any:
        """Simulated s."""
        return self.session.wait_for(condition, limit_s, what)

    def kill(self, name: str) -> None:
        """The node is gone, without last messages."""
        self.session.kill(name)

    def forget(self, *forgotten: topics.Topic) -> None:
        """Drop what was recorded of some topics; none: of all."""
        self.session.forget(*forgotten)

    def messages(self, topic: topics.Topic) -> list[Any]:
        """Since it was forgotten."""
        return self.session.messages(topic)

    def values(self, topic: topics.Topic) -> list[Any]:
        """As ``messages``, the ``data`` alone."""
        return self.session.values(topic)

    def latest(self, topic: topics.Topic) -> Any:
        """The last message, be it forgotten or not; None: none."""
        return self.session.latest(topic)

    def value(self, topic: topics.Topic) -> Any:
        """Its ``data``."""
        message = self.latest(topic)
        return None if message is None else message.data

    @property
    def state(self) -> str:
        return str(self.value(topics.GAME_STATE))

    def until(self, state: str) -> None:
        """Wait for a state."""
        self.wait(lambda: self.state == state, f"state {state}")

    def collected(self) -> list[int]:
        """Ids reported in this round, in order; a report may be made more than once."""
        words = self.values(topics.GAME_STATUS)
        return [int(word.partition(":")[2]) for word in words if word.startswith("pellet_collected")]

    def removed(self) -> set[int]:
        """Pellets that the planner has had removed in this round."""
        return set(self.values(topics.REMOVE_PELLET))

    def robot(self) -> tuple[float, float]:
        """Where it believes that it is."""
        return pose_of(self.latest(topics.AMCL_POSE))[:2]

    def drives(self) -> bool:
        """Whether the robot moves."""
        return abs(self.latest(topics.ODOMETRY).twist.twist.linear.x) > 0.02 or abs(self.turn()) > 0.05

    def turn(self) -> float:
        """rad/s."""
        return float(self.latest(topics.ODOMETRY).twist.twist.angular.z)

    def menu(self) -> None:
        """Nothing goes on; what was recorded before is forgotten."""
        assert self.session.call(topics.RESET_GAME).success
        self.until("menu")
        self.wait(lambda: not self.drives(), "the robot to stand")
        self.forget()

    def begin(self) -> None:
        """A round, as far as the start show."""
        self.menu()
        assert self.session.call(topics.START_GAME).success
        self.until("starting")

    def play(self, left: int = 5) -> None:
        """A round that runs, with some pellets to go."""
        if self.state != "running" or self.value(topics.PELLETS_SPAWNED) - self.value(topics.PELLETS_COLLECTED) < left:
            self.begin()
        self.until("running")
        self.wait(lambda: self.value(topics.PELLETS_SPAWNED) > 0, "the pellets")

    def away(self) -> bool:
        """Whether the robot is far from home."""
        return math.hypot(*self.robot()) > FAR_M

    def collect(self, more: int) -> None:
        """The round goes on by some pellets, each of which counts once."""
        assert self.counted()
        had = self.value(topics.SCORE)
        self.wait(lambda: self.value(topics.SCORE) >= had + more, f"{more} pellets more")
        assert self.state == "running"
        assert self.counted()

    def counted(self) -> bool:
        """Whether all that is reported counts, and nothing else, in the first round."""
        return bool(self.value(topics.SCORE) == self.value(topics.PELLETS_COLLECTED) == len(set(self.collected())))

    @contextmanager
    def held(self) -> Iterator[None]:
        """The robot goes nowhere, once it has arrived where it drives to."""
        self.session.publish(FAULT, "reject")
        try:
            yield
        finally:
            self.session.publish(FAULT, "end reject")

    def complete(self) -> tuple[int, int]:
        """The round is over, as the planner reports, far from home; its score, and its number."""
        self.play(7)
        self.wait(lambda: self.away() or self.state != "running", "the robot to be away")
        assert self.state == "running"
        round_ = self.value(topics.ROUND)
        self.session.publish(topics.GAME_STATUS, "game_complete")
        assert self.state == "returning_home"
        assert "dying" not in self.values(topics.GAME_STATE)
        result = str(self.value(topics.GAME_RESULT))
        assert "Complete" in result
        return int(result.rpartition(" ")[2]), round_

    def stands_at(self, score: int, round_: int) -> None:
        """What the referee counts."""
        assert (self.value(topics.SCORE), self.value(topics.ROUND)) == (score, round_)

    def die(self) -> None:
        """Clyde is where the robot is, so that the planner sees it."""

        def caught() -> bool:
            self.session.publish(topics.CLYDE_POSE, pose_message(*self.robot(), 0.0, self.session.stamp()))
            return "death_detected" in self.values(topics.GAME_STATUS)

        self.wait(caught, "the death")

    def nodes_are_there(self) -> None:
        """Start what a test that has failed halfway has left out."""
        for name in ("pellet_manager", "audio_node", "game_light_node", "clyde_ghost_node", "game_event_mapper"):
            if self.session.game.member(name) is None:
                self.start(name)
        for name in (REFEREE, SELECTOR):
            if self.session.game.member(name) is None:
                self.start(name)
