"""What the original's nodes have in common: two kinds of QoS, a map, and an end at Ctrl-C without a last word."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from pacman_env.world.maps.occupancy import OccupancyMap, load_map

#: Depth 1: of commands in a burst only the last is sure to arrive.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)
EVENTS = 10  # reliable, volatile
FREE_GREY = 250  # brighter is free

Place = tuple[float, float]


def run(make: Callable[[], Node]) -> int:
    """Spin until Ctrl-C; nothing is said at the end.

    ROS's own handler stays out: it ends the context in the middle of a callback, which then fails now and then.
    """
    asked: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: asked.append(number))
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    node = make()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not asked:
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()
    return 0


def now_s(node: Node) -> float:
    """The node's time."""
    return float(node.get_clock().now().nanoseconds) * 1e-9


def map_of(node: Node) -> OccupancyMap:
    """The map of the parameter ``map_yaml``."""
    return load_map(node.declare_parameter("map_yaml", "").value)


def clear(map: OccupancyMap, clearance_m: float) -> NDArray[np.bool_]:
    """(H, W) cells whose whole square neighbourhood is free."""
    free = np.asarray(map.grey) > FREE_GREY
    reach = round(clearance_m / map.resolution)
    wide = np.zeros_like(free)
    inner = free.copy()
    for axis in (0, 1):
        wide = inner.copy()
        for step in range(1, reach + 1):
            for way in (step, -step):
                shifted = np.roll(inner, way, axis)
                edge = [slice(None)] * 2
                edge[axis] = slice(0, way) if way > 0 else slice(way, None)
                shifted[tuple(edge)] = False
                wide &= shifted
        inner = wide
    return wide


def world(map: OccupancyMap, column: int, row: int) -> Place:
    """A pixel's place: x = u R + x0, y = (H - v) R + y0."""
    return column * map.resolution + map.origin[0], (map.height - row) * map.resolution + map.origin[1]


def answer(response: Any, success: bool, message: str) -> Any:
    """Fill in a Trigger's response."""
    response.success, response.message = success, message
    return response
