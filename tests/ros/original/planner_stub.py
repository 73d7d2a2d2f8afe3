"""The original's planner, in the goal selector's place.

It cancels and sends; it knows the pose of ``amcl_pose`` alone; a pellet whose goal was aborted is removed uncounted and
sent once more; one whose goal was rejected is sent again every 0.5 s; a goal accepted after ``disable`` drives on.
"""

from __future__ import annotations

import math
from typing import Any

from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionClient
from rclpy.node import Node
from std_msgs.msg import Int32, String
from visualization_msgs.msg import Marker, MarkerArray

from tests.ros.original.common import EVENTS, LATCHED, Place, run

TICK_S, MARGIN, PICK_UP_M, DEATH_M, AT_HOME_M = 0.5, 0.3, 0.25, 0.25, 0.30
RISK_M, RISK_PER_M, DIRECTION, THREAT_M = 2.0, 3.0, 5.0, 2.0
HOME = -1  # the target of the way home


class PlannerStub(Node):
    def __init__(self) -> None:
        super().__init__("planner_stub")
        self.pose: Place | None = None
        self.home: Place | None = None
        self.clyde: Place | None = None
        self.pellets: dict[int, Place] = {}
        self.seen = self.enabled = False
        self.target: int | None = None
        self.goal: Any = None
        self.reports = self.create_publisher(String, "game_status", EVENTS)
        self.event = self.create_publisher(String, "game_event", EVENTS)
        self.remove = self.create_publisher(Int32, "remove_pellet", EVENTS)
        self.nav2 = ActionClient(self, NavigateToPose, "navigate_to_pose")
        self.create_subscription(PoseWithCovarianceStamped, "amcl_pose", self.hear_pose, LATCHED)
        self.create_subscription(MarkerArray, "pellet_markers", self.hear_pellets, EVENTS)
        self.create_subscription(PoseStamped, "clyde_pose", self.hear_clyde, EVENTS)
        self.create_subscription(String, "game_command", self.hear_command, LATCHED)
        self.create_timer(TICK_S, self.tick)

    def hear_pose(self, message: Any) -> None:
        self.pose = message.pose.pose.position.x, message.pose.pose.position.y
        self.home = self.home or self.pose

    def hear_clyde(self, message: Any) -> None:
        self.clyde = message.pose.position.x, message.pose.position.y

    def hear_pellets(self, message: Any) -> None:
        self.pellets, self.seen = {}, True
        for marker in message.markers:
            if marker.action == Marker.ADD and marker.ns == "pellets":
                self.pellets[marker.id] = marker.pose.position.x, marker.pose.position.y

    def hear_command(self, message: Any) -> None:
        word = message.data
        self.enabled = word == "enable"
        if word != "enable":
            self.cancel()
        if word == "reset_round":
            self.seen = False
        if word == "return_home":
            self.go_home()

    def go_home(self) -> None:
        if self.home is None or self.pose is None:
            self.say("home_failed")
        elif math.dist(self.home, self.pose) <= AT_HOME_M:
            self.say("home_reached")
        else:
            self.send(HOME, self.home)

    def say(self, word: str) -> None:
        self.reports.publish(String(data=word))

    def send(self, target: int, place: Place) -> None:
        if not self.nav2.server_is_ready() and not self.nav2.wait_for_server(timeout_sec=2.0):
            if target == HOME:
                self.say("home_failed")
            return
        pose = PoseStamped()
        pose.header.frame_id, pose.header.stamp = "map", self.get_clock().now().to_msg()
        pose.pose.position.x, pose.pose.position.y, pose.pose.orientation.w = *place, 1.0
        self.target = target
        answer = self.nav2.send_goal_async(NavigateToPose.Goal(pose=pose))
        answer.add_done_callback(lambda answer: self.answered(answer.result(), target))

    def answered(self, goal: Any, target: int) -> None:
        if not goal.accepted:
            if target == self.target:
                self.target = None
            if target == HOME:
                self.say("home_failed")
            return
        self.goal = goal  # even after ``disable``
        goal.get_result_async().add_done_callback(lambda result: self.ended(goal, target, result.result().status))

    def ended(self, goal: Any, target: int, status: int) -> None:
        current = goal is self.goal
        if current:
            self.goal = self.target = None
        if target == HOME:
            if current:
                self.say("home_reached" if status == GoalStatus.STATUS_SUCCEEDED else "home_failed")
        elif status == GoalStatus.STATUS_SUCCEEDED and self.enabled:
            self.collect(target)
        elif status == GoalStatus.STATUS_ABORTED and self.enabled and current:
            self.remove.publish(Int32(data=target))  # and nobody counts it

    def collect(self, number: int) -> None:
        if self.pellets.pop(number, None) is not None:
            self.remove.publish(Int32(data=number))
            self.say(f"pellet_collected:{number}")

    def cancel(self) -> None:
        if self.goal is not None:
            self.goal.cancel_goal_async()
        self.goal = self.target = None

    def tick(self) -> None:
        if not self.enabled or self.pose is None or self.clyde is None or not self.seen:
            return
        for number in [n for n, place in self.pellets.items() if math.dist(place, self.pose) <= PICK_UP_M]:
            self.collect(number)
            if number == self.target:
                self.cancel()
        if math.dist(self.pose, self.clyde) <= DEATH_M:
            self.event.publish(String(data="clyde killed"))
            self.say("death_detected")
            self.enabled = False
            self.cancel()
            return
        if not self.pellets:
            self.enabled = False
            self.cancel()
            self.say("game_complete")
            return
        scores = {number: self.score(place) for number, place in self.pellets.items()}
        best = min(scores, key=lambda number: scores[number])
        if self.target is None:
            self.send(best, self.pellets[best])
        elif scores[best] + MARGIN < scores.get(self.target, math.inf):
            self.cancel()
            self.send(best, self.pellets[best])

    def score(self, place: Place) -> float:
        assert self.pose is not None
        assert self.clyde is not None
        risk = max(0.0, RISK_M - math.dist(place, self.clyde)) * RISK_PER_M
        way = [place[k] - self.pose[k] for k in (0, 1)]
        to_clyde = [self.clyde[k] - self.pose[k] for k in (0, 1)]
        length = math.hypot(*way) * math.hypot(*to_clyde)
        cosine = (way[0] * to_clyde[0] + way[1] * to_clyde[1]) / length if length else 0.0
        threatened = math.hypot(*to_clyde) <= THREAT_M
        return math.hypot(*way) + risk + (DIRECTION * (1 + cosine) if threatened and cosine > 0 else 0.0)


def main() -> int:
    return run(PlannerStub)
