"""The simulated robot's node in the two drawn rooms, and goals sent to it."""

import json
from typing import Any

from action_msgs.msg import GoalStatus

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import SIMULATOR
from pacman_env.ros.message_conversion import pose_message, pose_of, twist_message
from pacman_env.ros.simulated_robot.sim_robot import FAULT, FAULTS_NOW
from tests.ros.session import Session
from tests.sim.robots import RIGHT, rooms

SUCCEEDED, CANCELED, ABORTED = GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED
LEFT = (-1.5, 1.0)

#: Settings for odometry without errors and scans without noise.
EXACT = [
    *(f"robot.odometry_{name}=0" for name in ("distance_error", "turn_error", "distance_noise", "turn_noise")),
    *("robot.odometry_heading_noise=0", "robot.wheel_slip=0", "observation.scan_noise=0"),
]


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
        self._nodes.wait_for(self.result().done, limit_s, "the end of a goal")
        return self.result().result().status, self.result().result().result

    def cancel(self) -> int:
        """How many goals are being cancelled."""
        assert self.accepted
        answer = self._nodes.within(self.answer.result().cancel_goal_async)
        assert answer.done()
        return len(answer.result().goals_canceling)


class Robot(Session):
    """The node in the two rooms, as the observer sees it."""

    def begin(self, **parameters: Any) -> None:
        self.record(topics.ODOMETRY, topics.AMCL_POSE, topics.TF, topics.SCAN, topics.SIMULATED_POSE, FAULTS_NOW)
        self.record(topics.DOCK_STATUS, topics.BATTERY_STATE, topics.HAZARD_DETECTION)
        self.start(SIMULATOR, map_yaml=rooms().save(self.folder / "rooms.yaml"), **parameters)
        self.client = topics.NAVIGATE_TO_POSE.client(self.observer)
        self.advance(0.05)

    def goal(self, x: float, y: float) -> Goal:
        pose = pose_message(x, y, 0.0, self.stamp())
        return Goal(self, self.client, topics.NAVIGATE_TO_POSE.type.Goal(pose=pose))

    def succeeds(self, x: float, y: float) -> bool:
        """Whether it drives to a new goal."""
        return self.goal(x, y).end()[0] == SUCCEEDED

    def on_its_way(self, seconds: float = 2.0) -> Goal:
        """Driving to the other room, for some time already."""
        goal = self.goal(*RIGHT)
        assert goal.accepted
        self.advance(seconds)
        return goal

    def act(self, action: topics.RosAction) -> Goal:
        return Goal(self, action.client(self.observer), action.type.Goal())

    def drive(self, v: float, omega: float, seconds: float) -> None:
        """Commands at 10 Hz, as a controller sends them."""
        for _ in range(round(10 * seconds)):
            self.publish(topics.CMD_VEL, twist_message(v, omega, self.stamp()))
            self.advance(0.1)

    def truth(self) -> tuple[float, float, float]:
        self.advance(0.1)
        return pose_of(self.last(topics.SIMULATED_POSE))

    def odometry(self) -> Any:
        """The last."""
        return self.last(topics.ODOMETRY)

    def speed(self) -> float:
        """By its odometry, m/s."""
        return float(self.odometry().twist.twist.linear.x)

    def place(self) -> tuple[float, float]:
        """By its odometry, which begins at home, the map's origin."""
        position = self.odometry().pose.pose.position
        return position.x, position.y

    def hazards(self) -> set[tuple[str, int]]:
        lists = self.messages(topics.HAZARD_DETECTION)
        return {(one.header.frame_id, one.type) for message in lists for one in message.detections}

    def fault(self, text: str, now: list[str]) -> None:
        """Say to ``sim/fault``; those faults are there then."""
        self.clear()
        self.publish(FAULT, text)
        assert [json.loads(words) for words in self.values(FAULTS_NOW)] == [now]
        self.advance(0.05)

    @property
    def troubles(self) -> dict[str, int]:
        """What the node has said once, and how often it happened."""
        return dict(self.node(SIMULATOR).once.counts)
