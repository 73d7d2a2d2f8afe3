"""The simulated robot's node in the two drawn rooms, and goals sent to it: for tests that talk to a real process."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from action_msgs.msg import GoalStatus

from pacman_env.ros import topics
from pacman_env.ros.messages import pose_message, seconds_of
from pacman_env.ros.simulated_robot.sim_robot import FAULT, FAULTS_NOW
from tests.sim.robots import RIGHT, rooms

if TYPE_CHECKING:
    from tests.ros.system import Probe, Process, System

NODE = "pacman_env.ros.simulated_robot.sim_robot"
SUCCEEDED, CANCELED, ABORTED = GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED
LEFT = (-1.5, 1.0)
COMPILE_S = 240.0


class Goal:
    """A goal of an action, sent."""

    def __init__(self, probe: Probe, client: Any, message: Any) -> None:
        self.probe = probe
        self.feedback: list[Any] = []
        self.answer = client.send_goal_async(message, feedback_callback=lambda m: self.feedback.append(m.feedback))
        self._result: Any = None

    @property
    def accepted(self) -> bool:
        self.probe.wait_for(self.answer.done, what="the answer to a goal")
        return bool(self.answer.result().accepted)

    def result(self) -> Any:
        """Its future."""
        assert self.accepted
        self._result = self._result or self.answer.result().get_result_async()
        return self._result

    def end(self, timeout_s: float = 30.0) -> tuple[int, Any]:
        """Status and result."""
        self.probe.wait_for(self.result().done, timeout_s, "the end of a goal")
        return self.result().result().status, self.result().result().result

    def cancel(self) -> int:
        """How many goals are being cancelled."""
        assert self.accepted
        answer = self.answer.result().cancel_goal_async()
        self.probe.wait_for(answer.done, what="the answer to a cancel")
        return len(answer.result().goals_canceling)


class Robot:
    """The node in the two rooms, as seen from the probe."""

    def __init__(self, probe: Probe, system: System, **parameters: Any) -> None:
        map_yaml = rooms().save(Path(system.folder) / "rooms.yaml")
        parameters = {"use_sim_time": True, "speed": 10.0, "map_yaml": map_yaml, **parameters}
        self.probe = probe
        self.process: Process = system.start(NODE, **parameters)
        probe.record(topics.ODOMETRY, topics.AMCL_POSE, topics.TF, FAULTS_NOW)
        probe.wait_for(lambda: probe.messages(topics.ODOMETRY), COMPILE_S, "odometry")
        probe.wait_for(lambda: probe.publisher(FAULT).get_subscription_count() > 0, what="the faults' listener")
        self.client: Any = None

    def goal(self, x: float, y: float, **changes: Any) -> Goal:
        if self.client is None:
            self.client = self.probe.action_client(topics.NAVIGATE_TO_POSE)
        pose = pose_message(x, y, 0.0, self.probe.stamp(), **changes)
        return Goal(self.probe, self.client, topics.NAVIGATE_TO_POSE.type.Goal(pose=pose))

    def on_its_way(self, seconds: float = 2.0) -> Goal:
        """Driving to the other room, for some simulated time already."""
        goal = self.goal(*RIGHT)
        assert goal.accepted
        self.wait_s(seconds)
        return goal

    def odometry(self) -> Any:
        """The last."""
        return self.probe.messages(topics.ODOMETRY)[-1]

    def place(self) -> tuple[float, float]:
        """By its odometry, which begins at home, the map's origin."""
        position = self.odometry().pose.pose.position
        return position.x, position.y

    def wait_until_at(self, place: tuple[float, float], within_m: float = 0.5) -> None:
        """For odometry that says so: an action's result may be heard before the odometry sent ahead of it."""
        self.probe.wait_for(lambda: math.dist(self.place(), place) < within_m, what=f"odometry at {place}")

    def wait_s(self, seconds: float) -> None:
        """Simulated time."""
        end = seconds_of(self.odometry().header.stamp) + seconds
        self.probe.wait_for(
            lambda: seconds_of(self.odometry().header.stamp) >= end, what=f"{seconds} s of simulated time"
        )

    def fault(self, text: str, now: list[str]) -> None:
        self.probe.forget()
        self.probe.publish(FAULT, text)
        self.probe.wait_for(lambda: now in map(json.loads, self.probe.values(FAULTS_NOW)), what=f"faults {now}")
        self.probe.wait_for(lambda: self.probe.messages(topics.ODOMETRY), what="odometry")

    def wait_for_words(self, words: str) -> None:
        self.probe.wait_for(lambda: words in self.process.output, what=f"{words!r} in the log")
