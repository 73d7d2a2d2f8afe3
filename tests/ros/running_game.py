"""A whole game in lock-step that tests bring to where they need it, and whose nodes they kill and freeze."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pacman_env.ros import topics
from pacman_env.ros.lock_step.game import RESTART_S
from pacman_env.ros.messages import pose_message, pose_of
from pacman_env.ros.standstill import DEFAULT_LEASE_S, STOOD_STILL
from pacman_env.ros.supervisor.game_nodes import GAME, SELECTOR
from tests.ros import session

FAR_M = 3.0  # from home
FROZEN_S = DEFAULT_LEASE_S + 5.0  # longer than the middleware's lease
CLYDE_MPS = 0.02  # a robot that stands for as long as its planner is away is not caught meanwhile
SETTINGS = (f"clyde.speed_mps={CLYDE_MPS}", "show.start_s=4", "show.death_s=5")
HOME = 0.0, 0.0, 0.0  # the map's
POLICY = "lookahead"  # not clyde_aware, whose rounds Clyde ends too often
RECORDED = (
    *(topics.GAME_STATE, topics.GAME_RESULT, topics.SCORE, topics.ROUND, topics.PELLETS_SPAWNED),
    *(topics.PELLETS_COLLECTED, topics.CLYDE_SPEED, topics.GAME_COMMAND, topics.GAME_STATUS, topics.GAME_LIGHT),
    *(topics.PELLET_MARKERS, topics.REMOVE_PELLET, topics.CLYDE_POSE, topics.AMCL_POSE, topics.ODOMETRY),
    topics.CMD_VEL,
)


class Game(session.Session):
    """All nodes but the operator, which is the test."""

    map = ""  # as ``map_yaml`` takes it

    def start_node(self, name: str, *left_out: str) -> None:
        """Start a node with its parameters but some."""
        own: dict[str, Any] = {}
        if name in ("pellet_manager", "clyde_ghost_node", SELECTOR):
            own["map_yaml"] = self.map
        if name == SELECTOR:
            own |= {"policy": POLICY, "home": list(HOME)}
        for parameter in left_out:
            del own[parameter]
        self.start(name, settings=list(SETTINGS), **own)

    def start_absent_nodes(self) -> None:
        """Start what a test that has failed halfway has left out."""
        for name in (*GAME, SELECTOR):
            if self.game.member(name) is None:
                self.start_node(name)

    @property
    def state(self) -> str:
        return str(self.value(topics.GAME_STATE))

    def until(self, state: str) -> None:
        """Wait for a state."""
        self.wait_for(lambda: self.state == state, 300.0, f"state {state}")

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

    def turn(self) -> float:
        """rad/s."""
        return float(self.latest(topics.ODOMETRY).twist.twist.angular.z)

    def drives(self) -> bool:
        """Whether the robot moves."""
        return abs(self.latest(topics.ODOMETRY).twist.twist.linear.x) > 0.02 or abs(self.turn()) > 0.05

    def begin(self) -> None:
        """A round, as far as the start show; what was recorded before is forgotten."""
        assert self.call(topics.RESET_GAME).success
        self.until("menu")
        self.wait_for(lambda: not self.drives(), what="the robot to stand")
        self.forget()
        assert self.call(topics.START_GAME).success
        self.until("starting")

    def play(self, left: int = 5) -> None:
        """A round that runs, with some pellets to go."""
        if self.state != "running" or self.value(topics.PELLETS_SPAWNED) - self.value(topics.PELLETS_COLLECTED) < left:
            self.begin()
        self.until("running")
        self.wait_for(lambda: self.value(topics.PELLETS_SPAWNED) > 0, what="the pellets")

    def collect(self, more: int) -> None:
        """The round goes on by some pellets, each of which counts once."""
        assert self.counted()
        had = self.value(topics.SCORE)
        self.wait_for(lambda: self.value(topics.SCORE) >= had + more, 300.0, f"{more} pellets more")
        assert self.state == "running"
        assert self.counted()

    def counted(self) -> bool:
        """Whether all that is reported counts, and nothing else, in the first round."""
        return bool(self.value(topics.SCORE) == self.value(topics.PELLETS_COLLECTED) == len(set(self.collected())))

    def complete(self) -> tuple[int, int]:
        """The round is over, as the planner reports, far from home; its score, and its number."""
        self.play(7)
        self.wait_for(lambda: math.hypot(*self.robot()) > FAR_M or self.state != "running", 300.0, "the robot's way")
        assert self.state == "running"
        round_ = self.value(topics.ROUND)
        self.publish(topics.GAME_STATUS, "game_complete")
        assert self.state == "returning_home"
        assert "dying" not in self.values(topics.GAME_STATE)
        result = str(self.value(topics.GAME_RESULT))
        assert "Complete" in result
        return int(result.rpartition(" ")[2]), round_

    def play_to_the_end(self, score: int) -> None:
        """The round is completed; every pellet of it counts."""
        self.wait_for(lambda: self.value(topics.GAME_RESULT) or self.state == "dying", 300.0, "the end of the round")
        assert self.value(topics.GAME_RESULT) == f"Complete - Score: {score}"
        assert self.value(topics.SCORE) == score

    def die(self) -> None:
        """Clyde is where the robot is, so that the planner sees it."""

        def caught() -> bool:
            self.publish(topics.CLYDE_POSE, pose_message(*self.robot(), 0.0, self.stamp()))
            return "death_detected" in self.values(topics.GAME_STATUS)

        self.wait_for(caught, what="the death")

    @contextmanager
    def frozen(self, name: str) -> Iterator[None]:
        """Have a node stand still meanwhile, until it ends and is started again."""
        nodes: Any = self.game
        restarts, since_s = len(nodes.restarts), self.now_s
        nodes.freeze_node(name)
        yield
        self.advance(since_s + FROZEN_S - self.now_s)
        nodes.thaw_node(name)
        assert [one[1:] for one in nodes.restarts[restarts:]] == [(name, STOOD_STILL)]
        self.wait_for(lambda: nodes.member(name), RESTART_S + 0.1, f"{name} to be there")


@contextmanager
def running(folder: Path, map: str, seed: int) -> Iterator[Game]:
    """A game in the menu, of which no node logs an error."""
    with session.game(folder, map, POLICY, seed, session=Game, settings=SETTINGS, home=HOME) as game:
        game.map = map
        game.record(*RECORDED)
        seen = (topics.PELLET_MARKERS, topics.CLYDE_POSE, topics.AMCL_POSE, topics.ODOMETRY)
        game.wait_for(lambda: None not in [game.latest(topic) for topic in seen], what="pellets, Clyde and the robot")
        yield game
        assert game.errors() == []
