"""Checks of discovery and of time: ROS, domain, namespace, base, simulated clock, stamps."""

import math
import statistics
from collections import deque
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from ...discovery import BEYOND
from ...game_nodes import SIMULATOR
from .check import FIREWALL, RESTART, Check, CheckTime, Finding, Observations, Source, count, listed, seconds

_RANGE, _LOCAL, _SERVER = "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "ROS_DISCOVERY_SERVER"
#: Environment variables that affect discovery, in addition to domain and range.
_VARIABLES = *BEYOND, "RMW_IMPLEMENTATION", "FASTRTPS_DEFAULT_PROFILES_FILE"
_REACHES = {"LOCALHOST": "this machine only", "OFF": "no other program", "SUBNET": "this machine and its network"}
_TRUE = ("1", "true", "yes", "on")


def _check_ros(robot: Observations) -> Finding:
    variables = {name: value for name, value in robot.environment.items() if value}
    local = variables.get(_LOCAL, "").lower() in _TRUE
    reach = "LOCALHOST" if local else variables.get(_RANGE, "SUBNET").upper()
    missing = [name for name in (_SERVER, "RMW_IMPLEMENTATION") if name not in variables]
    summary = "; ".join(
        [
            f"domain {robot.domain}, {robot.middleware or 'unknown middleware'}, sees {_REACHES.get(reach, reach)}",
            *(f"{name}={Path(variables[name]).name}" for name in _VARIABLES if name in variables),
            *([f"not set: {', '.join(missing)}"] if missing else []),
        ]
    )
    if reach == "OFF":
        return Finding.bad(summary, "let it see others", f"export {_RANGE}=SUBNET")
    if _SERVER in variables and variables.get("ROS_SUPER_CLIENT", "").lower() not in _TRUE:
        remedy = "with a discovery server only a super client sees all nodes"
        return Finding.unknown(summary, remedy, "export ROS_SUPER_CLIENT=True")
    return Finding.ok(summary)


def _check_domain(robot: Observations) -> Finding:
    if robot.nodes:
        return Finding.ok(f"{count(len(robot.nodes), 'node')} discovered in domain {robot.domain}")
    remedy = (
        "robot and this machine: one network, one ROS_DOMAIN_ID (turtlebot4-setup on the robot), no firewall; "
        "where a network drops multicast, the discovery server of turtlebot4-setup"
    )
    if robot.environment.get(_RANGE, "").upper() == "LOCALHOST":
        remedy = f"unset {_RANGE}, which is LOCALHOST; {remedy}"
    summary = f"no node discovered in domain {robot.domain} {robot.within}"
    if robot.virtual:
        remedy = "name the domain of the game that is up, --domain-id N, or start one"
        return Finding.bad(summary, remedy, robot.start_game, settled=False)
    return Finding.bad(summary, remedy, FIREWALL, settled=False)


def _check_namespace(robot: Observations) -> Finding:
    if robot.own:
        return Finding.ok(f"{count(len(robot.own), 'node')} in {robot.namespace}")
    summary = f"no node discovered in {robot.namespace} {robot.within}"
    if not robot.nodes:
        return Finding.unknown(summary, settled=False)
    ends = [topic.rpartition("/") for topic, nodes in robot.publishers.items() if nodes]
    # Names with "/_" belong to topics within a Create 3.
    robots = {where or "/" for where, _, last in ends if last == "odom" and "/_" not in where}
    others = sorted(robots or {name.rpartition("/")[0] or "/" for name in robot.nodes})
    nearest = others[0].strip("/") or "/"
    remedy = f"did you mean --namespace {nearest}? If not, set the robot's in turtlebot4-setup"
    return Finding.bad(f"{summary}; others in {listed(others)}", remedy, settled=False)


def _check_base(robot: Observations) -> Finding:
    simulator, bases = robot.full(SIMULATOR), robot.publishers_of("odom")
    real = sorted({*bases, *robot.publishers_of("scan")} - {simulator})
    if robot.in_simulation and real:
        summary = f"a simulated robot, {simulator}, and a real one, {listed(real)}: the game drives both"
        remedy = "stop the simulated one (Ctrl-C) and start it in another domain"
        return Finding.bad(summary, remedy, f"{robot.start_game} --domain-id {robot.other_domain}")
    if len(bases) > 1:
        remedy = "two robots in one namespace: set another for one of them in turtlebot4-setup"
        return Finding.bad(f"{len(bases)} nodes publish {robot.full('odom')}: {listed(bases)}", remedy)
    if bases:
        return Finding.ok(f"{'simulated, ' if robot.in_simulation else ''}{bases[0]}")
    summary = f"no publisher of {robot.full('odom')} discovered {robot.within}"
    return robot.not_yet(summary, "on the robot", RESTART)


SKEW_S = 0.2  # Nav2's layer for Clyde drops its points 0.5 s after the stamp (config/nav2.yaml)
_FEWEST, _MOST = 5, 2000  # stamps of a topic: needed, and stored
_SPAN_S = 0.5  # shortest time over which a rate is measured
_LONGEST_TURN_S = 0.5


class Clock(NamedTuple):
    """First and last message on ``/clock``: monotonic time of its arrival, and its content, s."""

    first_s: float
    first_clock_s: float
    last_s: float
    clock_s: float

    @property
    def rate(self) -> float | None:
        """Speed of the clock relative to monotonic time; None until known."""
        span_s = self.last_s - self.first_s
        return (self.clock_s - self.first_clock_s) / span_s if span_s > _SPAN_S else None


@dataclass
class Delays:
    """Arrival minus stamp, s, of one topic's messages: by this machine's clock, and by ``/clock``."""

    wall_s: deque[float] = field(default_factory=lambda: deque(maxlen=_MOST))
    clock_s: deque[float] = field(default_factory=lambda: deque(maxlen=_MOST))
    turn_s: float = 0.0  # duration of a scan, from its stamp to its end
    last_s: float = math.inf  # monotonic time of the last arrival


def _add_tick(previous: Clock | None, message: Any, arrival: CheckTime) -> Clock:
    now = arrival.monotonic_s, seconds(message.clock)
    return Clock(*(now if previous is None else previous[:2]), *now)


def _add_delay(previous: Delays | None, message: Any, arrival: CheckTime) -> Delays:
    delays = previous or Delays()
    delays.last_s = arrival.monotonic_s
    # Only transforms whose parent is odom: AMCL stamps the transform from the map to odom ahead.
    transforms = [one for one in getattr(message, "transforms", ()) if one.header.frame_id.lstrip("/") == "odom"]
    for stamp_s in (seconds(one.header.stamp) for one in ([message] if hasattr(message, "header") else transforms)):
        delays.wall_s.append(arrival.wall_s - stamp_s)
        if arrival.clock_s is not None:
            delays.clock_s.append(arrival.clock_s - stamp_s)
    turn_s = float(getattr(message, "scan_time", 0.0))
    delays.turn_s = min(turn_s, _LONGEST_TURN_S) if turn_s > 0 else 0.0  # also refuses NaN
    return delays


CLOCK = Source("/clock", "rosgraph_msgs/Clock", _add_tick, "SENSOR_DATA")
STAMPS = {
    "odom": Source("odom", "nav_msgs/Odometry", _add_delay, "SENSOR_DATA"),
    "scan": Source("scan", "sensor_msgs/LaserScan", _add_delay, "SENSOR_DATA"),
    "tf": Source("tf", "tf2_msgs/TFMessage", _add_delay),
}


def by_clock(robot: Observations) -> bool:
    """Return True if the robot's stamps follow ``/clock``, not a wall clock."""
    clock = robot.get(CLOCK)
    if clock is None or clock.rate is None:
        return False
    delays = [one for source in STAMPS.values() if (one := robot.get(source))]
    wall_s = [abs(s) for one in delays for s in one.wall_s]
    clock_s = [abs(s) for one in delays for s in one.clock_s]
    if not wall_s or not clock_s:
        return robot.in_simulation
    return statistics.median(clock_s) < statistics.median(wall_s)


def _check_clock(robot: Observations) -> Finding:
    owners, clock = robot.publishers_of("/clock"), robot.get(CLOCK)
    rate = None if clock is None else clock.rate
    if len(owners) > 1:
        remedy = f"end all but one, or give it another domain: export ROS_DOMAIN_ID={robot.other_domain}"
        return Finding.bad(f"{len(owners)} publish /clock: {listed(owners)}", remedy)
    if by_clock(robot):
        owner = owners[0] if owners else "/clock"
        return Finding.ok(f"simulated, by {owner}, {rate or 0.0:.1f} times real time")
    if not owners:
        return Finding.ok("no node publishes /clock: nodes use the system time")
    if rate is None:
        remedy = "listen for longer: --wait 30"
        return Finding.unknown(f"{owners[0]}: {robot.silence('/clock')}", remedy, settled=False)
    return Finding.ok(f"{owners[0]} publishes /clock; the robot's stamps are not by it")


def _check_stamps(topic: str, robot: Observations) -> Finding | None:
    if by_clock(robot) or (robot.in_simulation and robot.publishers_of("/clock")):
        return None  # only one clock, or ``/clock`` was not received, which another check reports
    delays = robot.get(STAMPS[topic]) or Delays()
    if len(delays.wall_s) < _FEWEST:
        return _too_few(topic, robot, len(delays.wall_s))
    late_s = statistics.median(delays.wall_s)
    side = "behind" if late_s >= 0 else "ahead of"
    summary = f"{abs(late_s):.2f} s {side} this machine's clock (median of {len(delays.wall_s)})"
    if -SKEW_S <= late_s <= SKEW_S + delays.turn_s:  # a scan is stamped at its start
        return Finding.ok(summary)
    scans = robot.get(STAMPS["scan"])
    if topic != "scan" and scans and abs(statistics.median(scans.wall_s or (0.0,))) < SKEW_S:
        remedy = "the base's own clock is off: its web page (port 8080 of the robot), Beta Features, Restart ntpd"
        return Finding.bad(summary, remedy)
    remedy = "synchronise the clocks by NTP (apt install chrony), on robot and this machine"
    return Finding.bad(f"{summary}; costmaps drop Clyde from {SKEW_S:g} s on", remedy, "sudo chronyc makestep")


def _too_few(topic: str, robot: Observations, stamps: int) -> Finding | None:
    summary = f"{count(stamps, 'stamp')} received {robot.within}" if stamps else robot.silence(topic)
    if topic == "scan" or (topic == "odom" and robot.get(STAMPS["scan"]) is not None):
        return None  # silence of the lidar and of the base is reported by their own checks
    if topic in robot.unavailable:
        return Finding.unknown(summary, *robot.waiting_remedy(topic), settled=False)
    if topic == "odom" and robot.publishers_of(topic) and not stamps:
        remedy = "its publisher is discovered, but no message arrives: check for a firewall that passes only discovery"
        return Finding.bad(summary, remedy, FIREWALL, settled=False)
    return Finding.unknown(summary, "see base and tf to base", settled=False)


CHECKS = (
    Check("ROS", "Which nodes can be discovered from here?", _check_ros, needs_robot=False),
    Check("domain", "Is any node in the ROS domain?", _check_domain, needs_robot=False),
    Check("namespace", "Are nodes in the robot's namespace?", _check_namespace, needs_robot=False),
    Check("base", "Does exactly one robot publish odometry?", _check_base),
    Check("clock", "Is there one simulated clock at most?", _check_clock, (CLOCK, *STAMPS.values()), False),
    *(
        Check(
            f"time of {topic}",
            f"Do the stamps of {topic} agree with this machine's clock?",
            partial(_check_stamps, topic),
        )
        for topic in STAMPS
    ),
)
