"""Checks of the robot itself: dock, battery, lidar, map, pose and transforms."""

import math
from collections import deque
from typing import Any, NamedTuple

import numpy as np

from ...map_comparison import differing_cells, grid_of, map_differences
from .check import RESTART, Check, CheckTime, Finding, Observations, Source, count, monitored, newest, seconds
from .domain import CLOCK, STAMPS, by_clock

FLAT = 0.2  # charge (0 to 1) at which a TurtleBot 4 warns; it switches off at 0.12
SLOWEST_SCAN_HZ = 4.0  # the RPLIDAR turns 5 to 10 times a second
FEWEST_SCANS = 3
FEWEST_RETURNS = 0.1  # share of rays; fewer mean that the lidar is covered


class ScanTally(NamedTuple):
    stamp_s: float
    rays: int
    returns: int  # number of rays with a return
    nearest_m: float
    farthest_m: float
    frame: str


def _add_scan(previous: deque[ScanTally] | None, message: Any, arrival: CheckTime) -> deque[ScanTally]:
    scans = deque(maxlen=2000) if previous is None else previous
    ranges = np.asarray(message.ranges, dtype=np.float64)
    good = ranges[np.isfinite(ranges) & (ranges >= message.range_min) & (ranges <= message.range_max)]
    nearest_m, farthest_m = float(good.min(initial=math.inf)), float(good.max(initial=0.0))
    frame = str(message.header.frame_id).lstrip("/")[:100]
    scans.append(ScanTally(seconds(message.header.stamp), len(ranges), len(good), nearest_m, farthest_m, frame))
    return scans


def _charge(message: Any) -> float:
    charge = float(message.percentage)
    if not 0.0 <= charge <= 1.0:  # also refuses NaN
        raise ValueError(f"percentage {charge:g}: must be 0 to 1")
    return charge


# A TurtleBot 4 subscribes to both as sensor data; best effort receives from every publisher.
DOCKED = Source("dock_status", "irobot_create_msgs/DockStatus", newest(lambda m: bool(m.is_docked)), "SENSOR_DATA")
CHARGE = Source("battery_state", "sensor_msgs/BatteryState", newest(_charge), "SENSOR_DATA")
SCANS = Source("scan", "sensor_msgs/LaserScan", _add_scan, "SENSOR_DATA")


SILENT_S = 2.0  # a base publishes odometry at least 20 times per second
_SILENT = "create3_republisher, through which odometry, tf, battery and dock pass, may have stopped; on the robot"


def _check_silence(robot: Observations) -> Finding | None:
    """Report a silent base: odometry passes the base's republisher, scans do not, and both need the network."""
    odometry = robot.get(STAMPS["odom"])
    if not robot.publishers_of("odom") or "odom" in robot.unavailable or not robot.get(STAMPS["scan"]):
        return None
    if odometry is None:
        summary = f"{robot.silence('odom')}, but scan: {_SILENT.partition(',')[0]} is silent"
        return robot.not_yet(summary, _SILENT, RESTART)
    silent_s = robot.now.monotonic_s - odometry.last_s
    if silent_s > SILENT_S:
        return robot.not_yet(f"odom silent for {silent_s:.1f} s, but scan is not", _SILENT, RESTART)
    return Finding.ok("odom arrives")


def _check_dock(robot: Observations) -> Finding:
    docked = robot.get(DOCKED)
    if docked is None:
        return robot.not_received(DOCKED)
    if docked:
        undock = f'ros2 action send_goal {robot.full("undock")} irobot_create_msgs/action/Undock "{{}}"'
        return Finding.bad("docked, where a TurtleBot 4 stops its lidar", "undock, with 1 m free behind it", undock)
    return Finding.ok("undocked")


def _check_battery(robot: Observations) -> Finding:
    charge = robot.get(CHARGE)
    if charge is None:
        return robot.not_received(CHARGE)
    if charge >= FLAT:
        return Finding.ok(f"{100 * charge:.0f} %")
    summary = f"{100 * charge:.0f} %, less than {100 * FLAT:.0f} %"
    if robot.get(DOCKED):
        return Finding.bad(summary, "leave it on its dock")
    dock = f'ros2 action send_goal {robot.full("dock")} irobot_create_msgs/action/Dock "{{}}"'
    return Finding.bad(summary, "charge it, within sight of its dock", dock)


def _check_lidar(robot: Observations) -> Finding:
    scans = robot.get(SCANS)
    if not scans or len(scans) < FEWEST_SCANS:
        summary = f"{count(len(scans), 'scan')} {robot.within}" if scans else robot.silence("scan")
        return robot.not_yet(summary, *_lidar_remedy(robot))
    stamps_s, rays, returns, nearest_m, farthest_m, _ = zip(*scans, strict=True)
    span_s, share = stamps_s[-1] - stamps_s[0], sum(returns) / max(sum(rays), 1)
    rate_hz = (len(scans) - 1) / span_s if span_s > 0 else 0.0
    ranges = f", {min(nearest_m):.2f} to {max(farthest_m):.2f} m" if share > 0 else ""
    summary = f"{rate_hz:.1f} Hz, {100 * share:.0f} % of rays return{ranges}"
    if share < FEWEST_RETURNS:
        return Finding.bad(summary, "the lidar may be covered: uncover it")
    if rate_hz < SLOWEST_SCAN_HZ and not by_clock(robot):
        remedy = f"less than {SLOWEST_SCAN_HZ:g} Hz arrive: a nearer access point, or run the game on the robot"
        return Finding.bad(summary, remedy)
    return Finding.ok(summary)


def _lidar_remedy(robot: Observations) -> tuple[str, str]:
    if SCANS.name in robot.unreadable:
        return "read its driver's log", ""
    if robot.get(DOCKED):
        return "undock: a docked TurtleBot 4 stops it", ""
    return "start its motor", f'ros2 service call {robot.full("start_motor")} std_srvs/srv/Empty "{{}}"'


FRESH_S = 1.0  # age of a transform; the goal selector's pose_timeout_s
LIDAR_FRAME = "rplidar_link"  # frame on the TurtleBot 4, until a scan gives another one
_FRAMES = 1000
_ESTIMATE = 'give the initial pose: RViz, "2D Pose Estimate", click where it stands, drag to where it faces'
_CELLS = {None: "off the map", 100: "in a wall", -1: "where the map is unknown"}


class Link(NamedTuple):
    """Parent of a frame, and the monotonic time of the last reception, s (None if static)."""

    parent: str
    received_s: float | None


def _add_links(previous: dict[str, Link] | None, message: Any, arrival: CheckTime) -> dict[str, Link]:
    from pacman_env.ros.message_conversion import transform_of

    links = previous or {}
    for transform in message.transforms:
        parent, child, _ = transform_of(transform)
        child = child.lstrip("/")
        if child in links or len(links) < _FRAMES:
            links[child] = Link(parent.lstrip("/"), arrival.monotonic_s)
    return links


def _add_static_links(previous: dict[str, Link] | None, message: Any, arrival: CheckTime) -> dict[str, Link]:
    return {child: Link(parent, None) for child, (parent, _) in _add_links(previous, message, arrival).items()}


GRID = Source("map", "nav_msgs/OccupancyGrid", newest(grid_of), "LATCHED")
POSE = monitored("pose", "amcl_pose", "geometry_msgs/PoseWithCovarianceStamped")
LINKS = Source("tf", "tf2_msgs/TFMessage", _add_links)
STATIC_LINKS = Source("tf_static", "tf2_msgs/TFMessage", _add_static_links, "STATIC_TRANSFORMS")


def _check_map(robot: Observations) -> Finding:
    grid, game = robot.get(GRID), robot.map
    if grid is None:
        remedy = "start localization with the game's map"
        return robot.not_yet(robot.silence("map"), remedy, robot.start_localization)
    rows, columns = grid.cells.shape
    summary = f"{columns} x {rows} cells of {grid.resolution:.3g} m"
    if game is None:
        return Finding.unknown(f"{summary}; not compared", "name the game's: --map FILE_OR_NAME")
    wrong = map_differences(grid, game)
    if not wrong:
        return Finding.ok(f"{summary}, {100 * differing_cells(grid, game):.1f} % differ from {game.name}")
    remedy = "localization and game need one file: start one of them again with the other's"
    command = "" if robot.virtual else robot.start_localization
    return Finding.bad(f"not {game.name}: {'; '.join(wrong)}", remedy, command)


def _check_pose(robot: Observations) -> Finding:
    stamped = robot.get(POSE)
    if stamped is None:
        if not robot.real_nav2 or robot.full("amcl") in robot.nodes or robot.publishers_of("amcl_pose"):
            return Finding.bad(f"{robot.silence('amcl_pose')}: no initial pose yet", _ESTIMATE, settled=False)
        remedy = "no amcl discovered either: start localization"
        return robot.not_yet(robot.silence("amcl_pose"), remedy, robot.start_localization)
    (x, y, heading), stamp_ns = stamped
    clock = robot.get(CLOCK)
    now_s = clock.clock_s if clock is not None and by_clock(robot) else robot.now.wall_s
    age = f"{now_s - stamp_ns / 1e9:.1f} s old"  # AMCL is silent while the robot stands
    summary = f"({x:.2f}, {y:.2f}) m, {math.degrees(heading):.0f} degrees, {age}"
    if robot.map is None:
        return Finding.ok(summary)
    column, row = (round(float(v)) for v in robot.map.world_to_cell(x, y))
    inside = 0 <= column < robot.map.width and 0 <= row < robot.map.height
    cell = int(robot.map.occupancy[row, column]) if inside else None
    if cell in _CELLS:
        return Finding.bad(f"{summary}: {_CELLS[cell]}", f"wrong map, or {_ESTIMATE}")
    return Finding.ok(f"{summary}, on free floor")


def _check_base_tf(robot: Observations) -> Finding:
    frames, ages = _frames_up_to(robot, "base_link", "map")
    if frames[-1] != "map":
        summary = _no_parent(robot, LINKS, frames[-1])
        return robot.not_yet(summary, *_transform_remedy(robot, frames[-1]))
    chain, oldest = " > ".join(reversed(frames)), max(ages, key=lambda child: ages[child], default=None)
    if oldest is None:
        return Finding.ok(chain)
    if ages[oldest] > FRESH_S:
        parent = frames[frames.index(oldest) + 1]
        summary = f"{parent} > {oldest} is {ages[oldest]:.1f} s old, more than {FRESH_S:g} s"
        return robot.not_yet(summary, *_transform_remedy(robot, oldest, stale=True))
    return Finding.ok(f"{chain}, {ages[oldest]:.2f} s old at most")


def _transform_remedy(robot: Observations, child: str, stale: bool = False) -> tuple[str, str]:
    if LINKS.name in robot.unavailable:
        return robot.waiting_remedy(LINKS.name)
    if child == "odom":
        if stale:
            return "AMCL publishes it with every scan: see lidar and dock", ""
        return "AMCL publishes it when it has an initial pose and scans: see pose and lidar", ""
    return "the base publishes it; on the robot", RESTART


def _check_lidar_tf(robot: Observations) -> Finding:
    scans = robot.get(SCANS)
    frames, _ = _frames_up_to(robot, scans[-1].frame if scans else LIDAR_FRAME, "base_link")
    if frames[-1] == "base_link":
        return Finding.ok(" > ".join(reversed(frames)))
    remedy = "the robot's description is not published; on the robot"
    return robot.not_yet(_no_parent(robot, STATIC_LINKS, frames[-1]), remedy, RESTART)


def _frames_up_to(robot: Observations, frame: str, top: str) -> tuple[list[str], dict[str, float]]:
    """Return the frames from ``frame`` up to ``top`` or the last known parent, and the ages (s) of links by child.

    Static links have no age.
    """
    static, dynamic = robot.get(STATIC_LINKS), robot.get(LINKS)
    links = {**(static or {}), **(dynamic or {})}
    frames, ages = [frame], {}
    while frame != top and frame in links and len(frames) <= len(links):
        parent, received_s = links[frame]
        if received_s is not None:
            ages[frame] = robot.now.monotonic_s - received_s
        frame = parent
        frames.append(frame)
    return frames, ages


def _no_parent(robot: Observations, source: Source[Any], frame: str) -> str:
    if source.name in robot.unavailable or source.name in robot.unreadable:
        return robot.silence(source.name)
    return f"no parent of {frame} received on {robot.full(source.name)} {robot.within}"


_TF = LINKS, STATIC_LINKS
CHECKS = (
    Check("base's messages", "Does the base publish, as its lidar does?", _check_silence),
    Check("dock", "Is the robot off its dock?", _check_dock, (DOCKED,)),
    Check("battery", "Is the battery charged?", _check_battery, (CHARGE,)),
    Check("lidar", "Does the lidar scan often enough, with nothing over it?", _check_lidar, (SCANS,)),
    Check("map", "Do localization and game use the same map?", _check_map, (GRID,)),
    Check("pose", "Is the robot localized, on free floor?", _check_pose, (POSE,)),
    Check("tf to base", "Are the transforms from map to base_link complete and recent?", _check_base_tf, _TF),
    Check("tf to lidar", "Is the transform from base_link to the lidar known?", _check_lidar_tf, _TF),
)
