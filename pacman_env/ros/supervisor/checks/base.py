"""Checks of the robot itself: dock, battery and lidar."""

from __future__ import annotations

import math
from collections import deque
from typing import Any, NamedTuple

import numpy as np

from .check import Check, Finding, Moment, Observations, Source, count, newest, seconds
from .clocks import by_clock
from .remedies import patience

FLAT = 0.2  # charge at which a TurtleBot 4 warns; it switches itself off at 0.12
SLOWEST_SCAN_HZ = 4.0  # the RPLIDAR turns 5 to 10 times a second
FEWEST_SCANS = 3
FEWEST_RETURNS = 0.1  # share of rays; less is a lidar that is covered


class Scan(NamedTuple):
    """A scan in short: stamp (s), rays and those with a return, the nearest and farthest (m), the lidar's frame."""

    stamp_s: float
    rays: int
    returns: int
    nearest_m: float
    farthest_m: float
    frame: str


def _add_scan(before: deque[Scan] | None, message: Any, arrival: Moment) -> deque[Scan]:
    scans = deque(maxlen=2000) if before is None else before
    ranges = np.asarray(message.ranges, dtype=np.float64)
    good = ranges[np.isfinite(ranges) & (ranges >= message.range_min) & (ranges <= message.range_max)]
    nearest_m, farthest_m = float(good.min(initial=math.inf)), float(good.max(initial=0.0))
    frame = str(message.header.frame_id).lstrip("/")[:100]
    scans.append(Scan(seconds(message.header.stamp), len(ranges), len(good), nearest_m, farthest_m, frame))
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
        if not scans or len(scans) < FEWEST_SCANS:
            summary = f"{count(len(scans), 'scan')} {robot.within}" if scans else robot.silence("scan")
            return self.silent(robot, summary, *self._remedy(robot))
        stamps_s, rays, returns, nearest_m, farthest_m, _ = zip(*scans, strict=True)
        span_s, share = stamps_s[-1] - stamps_s[0], sum(returns) / max(sum(rays), 1)
        rate_hz = (len(scans) - 1) / span_s if span_s > 0 else 0.0
        ranges = f", {min(nearest_m):.2f} to {max(farthest_m):.2f} m" if share > 0 else ""
        summary = f"{rate_hz:.1f} Hz, {100 * share:.0f} % of rays return{ranges}"
        if share < FEWEST_RETURNS:
            return self.bad(summary, "is something on it, or is it covered? free it")
        if rate_hz < SLOWEST_SCAN_HZ and not by_clock(robot):
            remedy = f"less than {SLOWEST_SCAN_HZ:g} Hz arrive: a nearer access point, or run the game on the robot"
            return self.bad(summary, remedy)
        return self.ok(summary)

    def _remedy(self, robot: Observations) -> tuple[str, str]:
        if SCANS.name in robot.unreadable:
            return "read its driver's log", ""
        if robot.get(DOCKED):
            return "undock: a docked TurtleBot 4 stops it", ""
        return "start its motor", f'ros2 service call {robot.full("start_motor")} std_srvs/srv/Empty "{{}}"'


CHECKS: tuple[Check, ...] = (Dock(), Battery(), Lidar())
