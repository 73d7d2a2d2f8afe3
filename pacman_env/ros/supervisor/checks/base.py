"""Checks of the robot itself: dock, battery and lidar."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pacman_env.ros.supervisor.checks.check import (
    Check,
    Finding,
    Moment,
    Observations,
    Source,
    count,
    newest,
    seconds,
)
from pacman_env.ros.supervisor.checks.clocks import by_clock
from pacman_env.ros.supervisor.checks.remedies import RESTART_GAME, patience, up

FLAT = 0.2  # charge at which a TurtleBot 4 warns; it switches itself off at 0.12
SLOWEST_SCAN_HZ = 4.0  # the RPLIDAR turns 5 to 10 times a second
FEWEST_SCANS = 3
FEWEST_RETURNS = 0.1  # share of rays; less is a lidar that is covered


@dataclass
class Scans:
    """Scans summed up: stamps (s), rays and those with a return, ranges (m), frame of the last."""

    stamps: deque[float] = field(default_factory=lambda: deque(maxlen=2000))
    rays: int = 0
    returns: int = 0
    nearest_m: float = math.inf
    farthest_m: float = 0.0
    frame: str = ""

    @property
    def rate_hz(self) -> float:
        """By the stamps."""
        span_s = self.stamps[-1] - self.stamps[0]
        return (len(self.stamps) - 1) / span_s if span_s > 0 else 0.0


def _add_scan(before: Scans | None, message: Any, arrival: Moment) -> Scans:
    scans = before or Scans()
    ranges = np.asarray(message.ranges, dtype=np.float64)
    good = ranges[np.isfinite(ranges) & (ranges >= message.range_min) & (ranges <= message.range_max)]
    scans.stamps.append(seconds(message.header.stamp))
    scans.rays += len(ranges)
    scans.returns += len(good)
    scans.nearest_m = min([scans.nearest_m, *good.tolist()])
    scans.farthest_m = max([scans.farthest_m, *good.tolist()])
    scans.frame = str(message.header.frame_id).lstrip("/")[:100]
    return scans


def _charge(message: Any) -> float:
    charge = float(message.percentage)
    if not 0.0 <= charge <= 1.0:  # nor NaN
        raise ValueError(f"percentage {charge:g}: must be 0 to 1")
    return charge


# A TurtleBot 4 subscribes to both as sensor data: best effort receives from every publisher.
DOCKED = Source(
    "dock_status", "irobot_create_msgs/DockStatus", newest(lambda message: bool(message.is_docked)), "SENSOR_DATA"
)
CHARGE = Source("battery_state", "sensor_msgs/BatteryState", newest(_charge), "SENSOR_DATA")
SCANS = Source("scan", "sensor_msgs/LaserScan", _add_scan, "SENSOR_DATA")


class Dock(Check):
    name, question = "dock", "Is the robot off its dock?"
    sources = (DOCKED,)

    def answer(self, robot: Observations) -> Finding:
        if robot.virtual:
            return self.unknown("a simulated robot has none")
        docked = robot.get(DOCKED)
        if docked is None:
            return self.unknown(robot.silence(DOCKED.name), *patience(robot, DOCKED.name), settled=False)
        if docked:
            undock = f'ros2 action send_goal {robot.full("undock")} irobot_create_msgs/action/Undock "{{}}"'
            return self.bad("docked, where a TurtleBot 4 stops its lidar", "undock, a metre free behind", undock)
        return self.ok("undocked")


class Battery(Check):
    name, question = "battery", "Is the battery charged?"
    sources = (CHARGE,)

    def answer(self, robot: Observations) -> Finding:
        if robot.virtual:
            return self.unknown("a simulated robot has none")
        charge = robot.get(CHARGE)
        if charge is None:
            return self.unknown(robot.silence(CHARGE.name), *patience(robot, CHARGE.name), settled=False)
        if charge >= FLAT:
            return self.ok(f"{100 * charge:.0f} %")
        summary = f"{100 * charge:.0f} %, less than {100 * FLAT:.0f} %"
        if robot.get(DOCKED):
            return self.bad(summary, "leave it on its dock")
        dock = f'ros2 action send_goal {robot.full("dock")} irobot_create_msgs/action/Dock "{{}}"'
        return self.bad(summary, "charge it, within sight of its dock", dock)


class Lidar(Check):
    name, question = "lidar", "Does the lidar scan often enough, with nothing over it?"
    sources = (SCANS,)

    def answer(self, robot: Observations) -> Finding:
        scans = robot.get(SCANS)
        if scans is None or len(scans.stamps) < FEWEST_SCANS:
            summary = f"{count(len(scans.stamps), 'scan')} {robot.within}" if scans else robot.silence("scan")
            return self.bad(summary, *self._silent(robot), settled=False)
        share = scans.returns / scans.rays if scans.rays else 0.0
        ranges = f", {scans.nearest_m:.2f} to {scans.farthest_m:.2f} m" if scans.returns else ""
        summary = f"{scans.rate_hz:.1f} Hz, {100 * share:.0f} % of rays return{ranges}"
        if share < FEWEST_RETURNS:
            return self.bad(summary, "is something on it, or is it covered? free it")
        if scans.rate_hz < SLOWEST_SCAN_HZ and not by_clock(robot):
            remedy = f"less than {SLOWEST_SCAN_HZ:g} Hz arrive: a nearer access point, or run the game on the robot"
            return self.bad(summary, remedy)
        return self.ok(summary)

    def _silent(self, robot: Observations) -> tuple[str, str]:
        if robot.virtual:
            return RESTART_GAME, up(robot)
        if SCANS.name in robot.unreadable:
            return "read its driver's log", ""
        if robot.get(DOCKED):
            return "undock: a docked TurtleBot 4 stops it", ""
        return "start its motor", f'ros2 service call {robot.full("start_motor")} std_srvs/srv/Empty "{{}}"'


CHECKS: tuple[Check, ...] = (Dock(), Battery(), Lidar())
