"""The original's ``clyde_ghost_node``: he may appear beside the robot, and has the costmap cleared every 0.4 s."""

from __future__ import annotations

import heapq
import math
import struct
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped, PoseStamped
from nav2_msgs.srv import ClearEntireCostmap
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Float32, String
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker

from tests.ros.original.common import EVENTS, LATCHED, Place, answer, clear, map_of, run, world

CLEARANCE_M, UPDATE_S, SPEED_MPS, CLEAR_S = 0.25, 0.2, 0.25, 0.4
AROUND_M, HEIGHT_M, DIAMETER_M = 0.05, 0.25, 0.35
Cell = tuple[int, int]  # row, column
WAYS = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]


class ClydeGhostNode(Node):
    def __init__(self) -> None:
        super().__init__("clyde_ghost_node")
        self.map = map_of(self)
        self.random = np.random.default_rng(self.declare_parameter("seed", 0).value)
        self.good = clear(self.map, CLEARANCE_M)
        self.cells = np.argwhere(self.good)
        self.speed_mps, self.running = SPEED_MPS, False
        self.respawn()
        self.pose = self.create_publisher(PoseStamped, "clyde_pose", EVENTS)
        self.marker = self.create_publisher(Marker, "clyde_marker", EVENTS)
        self.obstacle = self.create_publisher(PointCloud2, "clyde_obstacle", EVENTS)
        self.costmap = self.create_client(ClearEntireCostmap, "global_costmap/clear_entirely_global_costmap")
        self.create_subscription(String, "game_state", self.hear_state, LATCHED)
        self.create_subscription(Float32, "clyde/speed", self.hear_speed, LATCHED)
        self.create_subscription(PointStamped, "clicked_point", self.hear_click, EVENTS)
        self.create_service(Trigger, "reset_clyde", self.reset)
        self.create_timer(UPDATE_S, self.update)
        self.create_timer(CLEAR_S, self.clear_costmap)

    def hear_state(self, message: Any) -> None:
        self.running = message.data == "running"

    def hear_speed(self, message: Any) -> None:
        self.speed_mps = message.data

    def hear_click(self, message: Any) -> None:
        apart = [math.dist(self.place(tuple(cell)), (message.point.x, message.point.y)) for cell in self.cells]
        self.stand(tuple(self.cells[int(np.argmin(apart))]))

    def reset(self, request: Any, response: Any) -> Any:
        self.respawn()
        return answer(response, True, "clyde reset")

    def drawn(self) -> Cell:
        row, column = self.cells[self.random.integers(len(self.cells))]
        return int(row), int(column)

    def respawn(self) -> None:
        """Anywhere, however near to the robot."""
        self.stand(self.drawn())

    def stand(self, cell: Cell) -> None:
        self.at, self.xy, self.path = cell, self.place(cell), []

    def place(self, cell: Cell) -> Place:
        return world(self.map, cell[1], cell[0])

    def planned(self, goal: Cell) -> list[Cell]:
        """A*, in eight directions, around corners; this takes the time in which no pose is sent."""
        best, came, queue = {self.at: 0.0}, {self.at: self.at}, [(0.0, self.at)]
        while queue:
            _, cell = heapq.heappop(queue)
            if cell == goal:
                path = []
                while cell != self.at:
                    path.append(cell)
                    cell = came[cell]
                return path[::-1]
            row, column = cell
            for i, j in WAYS:
                new = row + i, column + j
                if not (self.is_good(new) and self.is_good((row + i, column)) and self.is_good((row, column + j))):
                    continue
                cost = best[cell] + math.hypot(i, j)
                if cost < best.get(new, math.inf):
                    best[new], came[new] = cost, cell
                    heapq.heappush(queue, (cost + math.dist(new, goal), new))
        return []

    def is_good(self, cell: Cell) -> bool:
        row, column = cell
        return 0 <= row < self.map.height and 0 <= column < self.map.width and bool(self.good[row, column])

    def update(self) -> None:
        if self.running:
            self.walk(self.speed_mps * UPDATE_S)
        self.show()

    def walk(self, left_m: float) -> None:
        if not self.path:
            self.path = self.planned(self.drawn())
        while self.path and left_m > 0.0:
            x, y = self.xy
            goal = self.place(self.path[0])
            apart = math.dist(self.xy, goal)
            if apart <= left_m:
                self.at, self.xy, left_m = self.path.pop(0), goal, left_m - apart
            else:
                share = left_m / apart
                self.xy, left_m = (x + share * (goal[0] - x), y + share * (goal[1] - y)), 0.0

    def show(self) -> None:
        x, y = self.xy
        pose = PoseStamped()
        pose.header.frame_id, pose.header.stamp = "map", self.get_clock().now().to_msg()
        pose.pose.position.x, pose.pose.position.y, pose.pose.orientation.w = x, y, 1.0
        self.pose.publish(pose)
        marker = Marker(header=pose.header, ns="ghosts", id=1, type=Marker.SPHERE, action=Marker.ADD, pose=pose.pose)
        marker.scale.x = marker.scale.y = marker.scale.z = DIAMETER_M
        marker.color.r, marker.color.g, marker.color.a = 1.0, 0.31, 1.0
        self.marker.publish(marker)
        ring = [(x + AROUND_M * math.cos(k * math.pi / 4), y + AROUND_M * math.sin(k * math.pi / 4)) for k in range(8)]
        points = [(x, y), *ring]
        fields = [PointField(name=n, offset=4 * k, datatype=PointField.FLOAT32, count=1) for k, n in enumerate("xyz")]
        data = b"".join(struct.pack("<fff", *point, HEIGHT_M) for point in points)
        cloud = PointCloud2(header=pose.header, height=1, width=len(points), fields=fields, point_step=12, data=data)
        cloud.row_step, cloud.is_dense = len(data), True
        self.obstacle.publish(cloud)

    def clear_costmap(self) -> None:
        if self.running and self.costmap.service_is_ready():
            self.costmap.call_async(ClearEntireCostmap.Request())


def main() -> int:
    return run(ClydeGhostNode)
