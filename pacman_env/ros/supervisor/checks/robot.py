"""Checks of the robot itself: dock, battery, lidar, map, pose and transforms."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ... import topics
from ...game_monitor import MONITORED
from ...map_comparison import differing_cells, grid_of, map_differences
from ...message_conversion import seconds_of, transform_of
from .check import RESTART, Check, CheckTime, Finding, Observations, Source, bad, count, newest, ok, unknown
from .domain import CLOCK, STAMPS, by_clock

FLAT = 0.2  # charge (0 to 1) at which a TurtleBot 4 warns; it switches off at 0.12
SLOWEST_SCAN_HZ = 4.0  # the RPLIDAR turns 5 to 10 times a second
FEWEST_SCANS = 3
FEWEST_RETURNS = 0.1  # share of rays; fewer mean that the lidar is covered


def _charge(message: Any) -> float:
    charge = float(message.percentage)
    if not 0.0 <= charge <= 1.0:  # also refuses NaN
        raise ValueError(f"percentage {charge:g}: must be 0 to 1")
    return charge


# A TurtleBot 4 subscribes to both as sensor data; best effort receives from every publisher.
DOCKED = newest(replace(topics.DOCK_STATUS, qos=topics.SENSOR_DATA), lambda message: bool(message.is_docked))
CHARGE = newest(replace(topics.BATTERY_STATE, qos=topics.SENSOR_DATA), _charge)

SILENT_S = 2.0  # a base publishes odometry at least 20 times per second
_SILENT = "create3_republisher, through which odometry, tf, battery and dock pass, may have stopped; on the robot"


def _check_silence(robot: Observations) -> Finding | None:
    """Report a silent base: odometry passes the base's republisher, scans do not, and both need the network."""
    if not robot.publishers_of("odom") or "odom" in robot.unavailable or not robot.get(STAMPS["scan"]):
        return None
    if not (arrivals := robot.arrivals.get(STAMPS["odom"])):
        summary = f"{robot.silence('odom')}, but scan: {_SILENT.partition(',')[0]} is silent"
    elif (silent_s := robot.now.monotonic_s - arrivals[-1]) > SILENT_S:
        summary = f"odom silent for {silent_s:.1f} s, but scan is not"
    else:
        return ok("odom arrives")
    return robot.not_yet(summary, _SILENT, RESTART)


def _check_dock(robot: Observations) -> Finding:
    docked = robot.get(DOCKED)
    if docked is None:
        return robot.not_received(DOCKED)
    if docked:
        undock = f'ros2 action send_goal {robot.full("undock")} irobot_create_msgs/action/Undock "{{}}"'
        return bad("docked, where a TurtleBot 4 stops its lidar", "undock, with 1 m free behind it", undock)
    return ok("undocked")


def _check_battery(robot: Observations) -> Finding:
    charge = robot.get(CHARGE)
    if charge is None:
        return robot.not_received(CHARGE)
    if charge >= FLAT:
        return ok(f"{100 * charge:.0f} %")
    summary = f"{100 * charge:.0f} %, less than {100 * FLAT:.0f} %"
    if robot.get(DOCKED):
        return bad(summary, "leave it on its dock")
    dock = f'ros2 action send_goal {robot.full("dock")} irobot_create_msgs/action/Dock "{{}}"'
    return bad(summary, "charge it, within sight of its dock", dock)


def _check_lidar(robot: Observations) -> Finding:
    scans = [stamp.message for stamp in robot.get(STAMPS["scan"]) or ()]
    if len(scans) < FEWEST_SCANS:
        summary = f"{count(len(scans), 'scan')} {robot.within}" if scans else robot.silence("scan")
        if robot.get(DOCKED):
            return robot.not_yet(summary, "undock: a docked TurtleBot 4 stops it")
        command = f'ros2 service call {robot.full("start_motor")} std_srvs/srv/Empty "{{}}"'
        return robot.not_yet(summary, "start its motor", command)
    first, last = scans[0], scans[-1]
    span_s = seconds_of(last.header.stamp) - seconds_of(first.header.stamp)
    ranges_m = np.concatenate([scan.ranges for scan in scans])
    good_m = ranges_m[np.isfinite(ranges_m) & (ranges_m >= last.range_min) & (ranges_m <= last.range_max)]
    share = len(good_m) / max(len(ranges_m), 1)
    rate_hz = (len(scans) - 1) / span_s if span_s > 0 else 0.0
    ranges = f", {good_m.min():.2f} to {good_m.max():.2f} m" if share > 0 else ""
    summary = f"{rate_hz:.1f} Hz, {100 * share:.0f} % of rays return{ranges}"
    if share < FEWEST_RETURNS:
        return bad(summary, "the lidar may be covered: uncover it")
    if rate_hz < SLOWEST_SCAN_HZ and not by_clock(robot):
        remedy = f"less than {SLOWEST_SCAN_HZ:g} Hz arrive: a nearer access point, or run the game on the robot"
        return bad(summary, remedy)
    return ok(summary)


FRESH_S = 1.0  # age of a transform; the goal selector's pose_timeout_s
LIDAR_FRAME = "rplidar_link"  # frame on the TurtleBot 4, until a scan gives another one
_FRAMES = 1000
_ESTIMATE = 'give the initial pose: RViz, "2D Pose Estimate", click where it stands, drag to where it faces'
_CELLS = {None: "off the map", 100: "in a wall", -1: "where the map is unknown"}


Links = dict[str, tuple[str, float]]  # by frame: its parent, and the monotonic time of the last reception, s


def _add_links(previous: Links | None, message: Any, arrival: CheckTime) -> Links:
    links = previous or {}
    for transform in message.transforms:
        parent, child, _ = transform_of(transform)
        child = child.lstrip("/")
        if child in links or len(links) < _FRAMES:
            links[child] = parent.lstrip("/"), arrival.monotonic_s
    return links


GRID = newest(topics.MAP, grid_of)
POSE = newest(*MONITORED["pose"])
LINKS = Source(topics.TF, _add_links)
STATIC_LINKS = Source(topics.TF_STATIC, _add_links)


def _check_map(robot: Observations) -> Finding:
    grid, game = robot.get(GRID), robot.map
    if grid is None:
        return robot.not_yet(
            robot.silence("map"), "start localization with the game's map", robot.launch("localization")
        )
    rows, columns = grid.cells.shape
    summary = f"{columns} x {rows} cells of {grid.resolution:.3g} m"
    if game is None:
        return unknown(f"{summary}; not compared", "name the game's: --map FILE_OR_NAME")
    wrong = map_differences(grid, game)
    if not wrong:
        return ok(f"{summary}, {100 * differing_cells(grid, game):.1f} % differ from {game.name}")
    remedy = "localization and game need one file: start one of them again with the other's"
    command = "" if robot.virtual else robot.launch("localization")
    return bad(f"not {game.name}: {'; '.join(wrong)}", remedy, command)


def _check_pose(robot: Observations) -> Finding:
    stamped = robot.get(POSE)
    if stamped is None:
        if not robot.real_nav2 or robot.has("amcl") or robot.publishers_of("amcl_pose"):
            return bad(f"{robot.silence('amcl_pose')}: no initial pose yet", _ESTIMATE, settled=False)
        remedy = "no amcl discovered either: start localization"
        return robot.not_yet(robot.silence("amcl_pose"), remedy, robot.launch("localization"))
    (x, y, heading), stamp_ns = stamped
    clock = robot.get(CLOCK)
    now_s = clock.clock_s if clock is not None and by_clock(robot) else robot.now.wall_s
    age = f"{now_s - stamp_ns / 1e9:.1f} s old"  # AMCL is silent while the robot stands
    summary = f"({x:.2f}, {y:.2f}) m, {math.degrees(heading):.0f} degrees, {age}"
    if robot.map is None:
        return ok(summary)
    column, row = (round(float(v)) for v in robot.map.world_to_cell(x, y))
    inside = 0 <= column < robot.map.width and 0 <= row < robot.map.height
    cell = int(robot.map.occupancy[row, column]) if inside else None
    if cell in _CELLS:
        return bad(f"{summary}: {_CELLS[cell]}", f"wrong map, or {_ESTIMATE}")
    return ok(f"{summary}, on free floor")


def _check_base_tf(robot: Observations) -> Finding:
    frames, ages = _frames_up_to(robot, "base_link", "map")
    child, problem = max(ages, key=lambda frame: ages[frame], default=""), ""
    if frames[-1] != "map":
        child, problem = frames[-1], _no_parent(robot, LINKS, frames[-1])
    elif ages and ages[child] > FRESH_S:
        parent = frames[frames.index(child) + 1]
        problem = f"{parent} > {child} is {ages[child]:.1f} s old, more than {FRESH_S:g} s"
    if not problem:
        return ok(" > ".join(reversed(frames)) + (f", {ages[child]:.2f} s old at most" if ages else ""))
    if child != "odom":
        return robot.not_yet(problem, "the base publishes it; on the robot", RESTART)
    return robot.not_yet(problem, "AMCL publishes it when it has an initial pose and scans: see pose, lidar and dock")


def _check_lidar_tf(robot: Observations) -> Finding:
    scans = robot.get(STAMPS["scan"])
    frame = scans[-1].message.header.frame_id.lstrip("/") if scans else LIDAR_FRAME
    frames, _ = _frames_up_to(robot, frame, "base_link")
    if frames[-1] == "base_link":
        return ok(" > ".join(reversed(frames)))
    remedy = "the robot's description is not published; on the robot"
    return robot.not_yet(_no_parent(robot, STATIC_LINKS, frames[-1]), remedy, RESTART)


def _frames_up_to(robot: Observations, frame: str, top: str) -> tuple[list[str], dict[str, float]]:
    """Return the frames from ``frame`` up to ``top`` or the last known parent, and the ages (s) of links by child.

    Static links have no age.
    """
    static, dynamic = robot.get(STATIC_LINKS) or {}, robot.get(LINKS) or {}
    links = static | dynamic
    frames, ages = [frame], {}
    while frame != top and frame in links and len(frames) <= len(links):
        if frame in dynamic:
            ages[frame] = robot.now.monotonic_s - dynamic[frame][1]
        frame, _ = links[frame]
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
    Check("lidar", "Does the lidar scan often enough, with nothing over it?", _check_lidar),
    Check("map", "Do localization and game use the same map?", _check_map, (GRID,)),
    Check("pose", "Is the robot localized, on free floor?", _check_pose, (POSE,)),
    Check("tf to base", "Are the transforms from map to base_link complete and recent?", _check_base_tf, _TF),
    Check("tf to lidar", "Is the transform from base_link to the lidar known?", _check_lidar_tf, _TF),
)
