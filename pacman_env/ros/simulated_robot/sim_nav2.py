"""Nav2 as the game uses it: goals, clearing of the global costmap, and ghosts as obstacles of the planner.

``sim/navigate_to_pose.py`` decides what happens to goals; this module receives, checks and answers them.
"""

from functools import partial
from typing import Any

from nav_msgs.msg import Path
from rclpy.duration import Duration
from rclpy.task import Future
from std_msgs.msg import Header

from ...sim.navigate_to_pose import Navigation
from ...sim.robot_simulation import SimulatedRobot
from .. import topics
from ..configured_node import ConfiguredNode
from ..message_conversion import GHOST_OBSTACLE, BadMessage, points_of, pose_message, pose_of
from .sim_actions import Server
from .sim_faults import Faults

MARK_LASTS_S = 2.0  # the lidar clears a ghost from the costmap when it is no longer published


class Nav2StandIn:
    """Simulated Nav2; call ``step`` instead of the robot's, and ``publish`` at each scan."""

    docked = False

    def __init__(self, node: ConfiguredNode, robot: SimulatedRobot) -> None:
        self.node, self.robot, self.navigation = node, robot, Navigation(robot)
        self._faults: Faults = {}
        self._late: list[tuple[float, Future]] = []  # delayed goals: robot time (s) of acceptance, and acceptance
        self._handles: dict[bytes, Any] = {}  # goals that have not ended
        self._marks: dict[int, tuple[float, float]] = {}  # by ghost: its last position, m
        self._marked_s = 0.0  # robot time at which the last position arrived
        self._plan_out, self._planned_step = topics.PLAN.publisher(node), -1
        self._server = Server(node, topics.NAVIGATE_TO_POSE, self._check, self._begin, self._cancel)
        self._clear_costmap = topics.CLEAR_GLOBAL_COSTMAP.server(node, self._clear)
        for number, topic in enumerate(topics.GHOST_POSES):
            node.listen(topic, partial(self._on_ghost, number), "bad ghost")
        node.listen(topics.CLYDE_OBSTACLE, self._on_obstacle, "bad obstacle")

    def command(self, v: float, omega: float) -> None:
        self.robot.set_velocity(v, omega)

    def step(self) -> None:
        if self._marks and self.robot.time_s - self._marked_s > MARK_LASTS_S + 1e-6:
            self._mark({})
        for goal in self.navigation.step():
            if goal.message:
                self.node.get_logger().info(f"goal ended with code {goal.error_code}: {goal.message}")
            handle = self._handles.pop(goal.key)
            self._server.end(handle, goal.status, error_code=goal.error_code, error_msg=goal.message)
        now_s = self.robot.time_s
        for due_s, acceptance in self._late:
            if due_s <= now_s:
                acceptance.set_result(None)
        self._late = [one for one in self._late if one[0] > now_s]

    def publish(self, stamp: Any) -> None:
        """Publish the feedback of the current goal, and each new plan, in the map frame."""
        if (feedback := self.navigation.feedback()) is not None:
            message = topics.NAVIGATE_TO_POSE.type.Feedback(
                current_pose=pose_message(*feedback.pose, stamp),
                navigation_time=Duration(seconds=feedback.time_s).to_msg(),
                estimated_time_remaining=Duration(seconds=feedback.remaining_s).to_msg(),
                number_of_recoveries=feedback.recoveries,
                distance_remaining=feedback.distance_m,
            )
            self._handles[feedback.key].publish_feedback(message)
        step, points = self.robot.plan
        if step != self._planned_step and len(points) > 0:
            self._planned_step = step
            poses = [pose_message(x, y, 0.0, stamp) for x, y in points.tolist()]
            self._plan_out.publish(Path(header=Header(stamp=stamp, frame_id="map"), poses=poses))

    def set_faults(self, faults: Faults) -> None:
        away, was_away = "nav2_away" in faults, "nav2_away" in self._faults
        self._faults = faults
        (self.navigation.abort_after_s,) = faults.get("abort", (None,))
        if away and not was_away:  # disappear like a dead process
            self.navigation.drop_goals()
            self._late.clear()
            self._handles.clear()
            self._server.close()
            self.node.destroy_service(self._clear_costmap)
        elif was_away and not away:
            self._server.open()
            self._clear_costmap = topics.CLEAR_GLOBAL_COSTMAP.server(self.node, self._clear)

    # Goals

    def _check(self, request: Any) -> Future | None:
        pose_of(request.pose)
        if "reject" in self._faults:
            raise BadMessage("as requested by a fault")
        if "late_acceptance" not in self._faults:
            return None
        acceptance: Future = Future()
        self._late.append((self.robot.time_s + self._faults["late_acceptance"][0], acceptance))
        return acceptance

    def _begin(self, handle: Any) -> None:
        key = bytes(handle.goal_id.uuid)
        self._handles[key] = handle
        x, y, _ = pose_of(handle.request.pose)
        self.navigation.send(key, x, y)

    def _cancel(self, handle: Any) -> bool:
        return self.navigation.cancel(bytes(handle.goal_id.uuid))

    # Obstacles

    def _on_ghost(self, number: int, message: Any) -> None:
        self._mark(self._marks | {number: pose_of(message)[:2]})

    def _on_obstacle(self, message: Any) -> None:
        points = points_of(message)
        around = len(GHOST_OBSTACLE) if len(points) % len(GHOST_OBSTACLE) == 0 else len(points)
        centres = points.reshape(-1, around, 2).mean(axis=1)
        self._mark({number: (x, y) for number, (x, y) in enumerate(centres.tolist())})

    def _mark(self, marks: dict[int, tuple[float, float]]) -> None:
        self._marks, self._marked_s = marks, self.robot.time_s
        self.robot.set_obstacles(list(marks.values()))

    def _clear(self, request: Any, response: Any) -> Any:
        self._mark({})
        return response
