"""The simulated robot's node in the two drawn rooms, in lock-step, and goals sent to it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from action_msgs.msg import GoalStatus

from pacman_env.ros import topics
from pacman_env.ros.messages import pose_message
from pacman_env.ros.simulated_robot.sim_robot import FAULT, FAULTS_NOW
from pacman_env.ros.supervisor.game_nodes import SIMULATOR
from tests.ros import session
from tests.ros.session import Session
from tests.sim.robots import RIGHT, rooms

SUCCEEDED, CANCELED, ABORTED = GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED
LEFT = (-1.5, 1.0)


class Goal:
    """A goal of an action, sent."""

    def __init__(self, nodes: Session, client: Any, message: Any) -> None:
        self._nodes = nodes
        self.feedback: list[Any] = []
        self.answer = nodes.within(
            lambda: client.send_goal_async(message, feedback_callback=lambda m: self.feedback.append(m.feedback))
        )
        self._result: Any = None

    @property
    def accepted(self) -> bool:
        self._nodes.wait_for(self.answer.done, what="the answer to a goal")
        return bool(self.answer.result().accepted)

    def result(self) -> Any:
        """Its future."""
        assert self.accepted
        self._result = self._result or self._nodes.within(self.answer.result().get_result_async)
        return self._result

    def end(self, limit_s: float = 300.0) -> tuple[int, Any]:
        """Status and result."""
        self._nodes.wait_for(self.result().done, limit_s, "the end of a goal")
        return self.result().result().status, self.result().result().result

    def cancel(self) -> int:
        """How many goals are being cancelled."""
        assert self.accepted
        answer = self._nodes.within(self.answer.result().cancel_goal_async)
        assert answer.done()
        return len(answer.result().goals_canceling)


class Robot:
    """The node in the two rooms, as the observer sees it."""

    def __init__(self, nodes: Session, **parameters: Any) -> None:
        map_yaml = rooms().save(nodes.folder / "rooms.yaml")
        self.nodes = nodes
        nodes.record(topics.ODOMETRY, topics.AMCL_POSE, topics.TF, FAULTS_NOW)
        nodes.start(SIMULATOR, map_yaml=map_yaml, **parameters)
        self.client = topics.NAVIGATE_TO_POSE.client(nodes.observer)
        nodes.advance(0.05)

    def goal(self, x: float, y: float, **changes: Any) -> Goal:
        pose = pose_message(x, y, 0.0, self.nodes.stamp(), **changes)
        return Goal(self.nodes, self.client, topics.NAVIGATE_TO_POSE.type.Goal(pose=pose))

    def on_its_way(self, seconds: float = 2.0) -> Goal:
        """Driving to the other room, for some time already."""
        goal = self.goal(*RIGHT)
        assert goal.accepted
        self.nodes.advance(seconds)
        return goal

    def odometry(self) -> Any:
        """The last."""
        return self.nodes.last(topics.ODOMETRY)

    def place(self) -> tuple[float, float]:
        """By its odometry, which begins at home, the map's origin."""
        position = self.odometry().pose.pose.position
        return position.x, position.y

    def is_at(self, place: tuple[float, float], within_m: float = 0.5) -> bool:
        """By its odometry."""
        return math.dist(self.place(), place) < within_m

    def fault(self, text: str, now: list[str]) -> None:
        """Say to ``sim/fault``; those faults are there then."""
        self.nodes.forget()
        self.nodes.publish(FAULT, text)
        assert [json.loads(words) for words in self.nodes.values(FAULTS_NOW)] == [now]
        self.nodes.advance(0.05)

    @property
    def troubles(self) -> dict[str, int]:
        """What the node has said once, and how often it happened."""
        return dict(self.nodes.node(SIMULATOR).once.counts)


@contextmanager
def robot(folder: Path, **parameters: Any) -> Iterator[Robot]:
    """The node, with these parameters; it gives the time."""
    with session.nodes(folder, gives_time=False) as nodes:
        yield Robot(nodes, **parameters)
