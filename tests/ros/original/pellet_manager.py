"""The original's ``pellet_manager``: all pellets of the map once a second, a DELETEALL first."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from std_msgs.msg import Int32
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from tests.ros.original.common import EVENTS, Place, answer, clear, map_of, run, world

SPACING_M, CLEARANCE_M, DIAMETER_M = 2.0, 0.30, 0.12


class PelletManager(Node):
    def __init__(self) -> None:
        super().__init__("pellet_manager")
        map = map_of(self)
        step, good = round(SPACING_M / map.resolution), clear(map, CLEARANCE_M)
        places = [world(map, u, v) for v in range(0, map.height, step) for u in range(0, map.width, step) if good[v, u]]
        self.all: dict[int, Place] = dict(enumerate(places))
        self.left = dict(self.all)
        self.markers = self.create_publisher(MarkerArray, "pellet_markers", EVENTS)
        self.create_subscription(Int32, "remove_pellet", self.remove, EVENTS)
        self.create_service(Trigger, "reset_pellets", self.reset)
        self.create_timer(1.0, self.show)

    def show(self) -> None:
        array = MarkerArray(markers=[self.marker(0, Marker.DELETEALL)])
        for number, (x, y) in self.left.items():
            marker = self.marker(number, Marker.ADD)
            marker.type = Marker.SPHERE
            marker.pose.position.x, marker.pose.position.y = x, y
            marker.scale.x = marker.scale.y = marker.scale.z = DIAMETER_M
            marker.color.r = marker.color.g = marker.color.a = 1.0
            array.markers.append(marker)
        self.markers.publish(array)

    def marker(self, number: int, action: int) -> Any:
        marker = Marker(ns="pellets", id=number, action=action)
        marker.header.frame_id, marker.header.stamp = "map", self.get_clock().now().to_msg()
        marker.pose.orientation.w = 1.0
        return marker

    def remove(self, message: Any) -> None:
        self.left.pop(message.data, None)
        self.show()

    def reset(self, request: Any, response: Any) -> Any:
        self.left = dict(self.all)
        self.show()
        return answer(response, True, "pellets reset")


def main() -> int:
    return run(PelletManager)
