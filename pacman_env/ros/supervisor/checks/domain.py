"""Checks of discovery and of time: ROS, domain, namespace, base, simulated clock, stamps."""

import statistics
from collections import deque
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from ... import topics
from ...discovery import BEYOND
from ...game_nodes import SIMULATOR
from ...message_conversion import seconds_of
from .check import FIREWALL, RESTART, Check, CheckTime, Finding, Observations, Source, bad, count, listed, ok, unknown

_RANGE, _LOCAL, _SERVER = "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "ROS_DISCOVERY_SERVER"
#: Environment variables that affect discovery, in addition to domain and range.
_VARIABLES = *BEYOND, "RMW_IMPLEMENTATION", "FASTRTPS_DEFAULT_PROFILES_FILE"
_REACHES = {"LOCALHOST": "this machine only", "OFF": "no other program", "SUBNET": "this machine and its network"}
_TRUE = ("1", "true", "yes", "on")


def _check_ros(robot: Observations) -> Finding:
    variables = {name: value for name, value in robot.environment.items() if value}
    local = variables.get(_LOCAL, "").lower() in _TRUE
    reach = "LOCALHOST" if local else variables.get(_RANGE, "SUBNET").upper()
    words = [f"domain {robot.domain}, {robot.middleware or 'unknown middleware'}, sees {_REACHES.get(reach, reach)}"]
    words += [f"{name}={Path(variables[name]).name}" for name in _VARIABLES if name in variables]
    if missing := [name for name in (_SERVER, "RMW_IMPLEMENTATION") if name not in variables]:
        words.append(f"not set: {', '.join(missing)}")
    summary = "; ".join(words)
    if reach == "OFF":
        return bad(summary, "let it see others", f"export {_RANGE}=SUBNET")
    if _SERVER in variables and variables.get("ROS_SUPER_CLIENT", "").lower() not in _TRUE:
        remedy = "with a discovery server only a super client sees all nodes"
        return unknown(summary, remedy, "export ROS_SUPER_CLIENT=True")
    return ok(summary)


def _check_domain(robot: Observations) -> Finding:
    if robot.nodes:
        return ok(f"{count(len(robot.nodes), 'node')} discovered in domain {robot.domain}")
    remedy = (
        "robot and this machine: one network, one ROS_DOMAIN_ID (turtlebot4-setup on the robot), no firewall; "
        "where a network drops multicast, the discovery server of turtlebot4-setup"
    )
    if robot.environment.get(_RANGE, "").upper() == "LOCALHOST":
        remedy = f"unset {_RANGE}, which is LOCALHOST; {remedy}"
    summary = f"no node discovered in domain {robot.domain} {robot.within}"
    if robot.virtual:
        remedy = "name the domain of the game that is up, --domain-id N, or start one"
        return bad(summary, remedy, robot.start_game, settled=False)
    return bad(summary, remedy, FIREWALL, settled=False)


def _check_namespace(robot: Observations) -> Finding:
    if robot.own:
        return ok(f"{count(len(robot.own), 'node')} in {robot.namespace}")
    summary = f"no node discovered in {robot.namespace} {robot.within}"
    if not robot.nodes:
        return unknown(summary, settled=False)
    ends = [topic.rpartition("/") for topic, nodes in robot.publishers.items() if nodes]
    # Names with "/_" belong to topics within a Create 3.
    robots = {where or "/" for where, _, last in ends if last == "odom" and "/_" not in where}
    others = sorted(robots or {name.rpartition("/")[0] or "/" for name in robot.nodes})
    nearest = others[0].strip("/") or "/"
    remedy = f"did you mean --namespace {nearest}? If not, set the robot's in turtlebot4-setup"
    return bad(f"{summary}; others in {listed(others)}", remedy, settled=False)


def _check_base(robot: Observations) -> Finding:
    simulator, bases = robot.full(SIMULATOR), robot.publishers_of("odom")
    real = sorted({*bases, *robot.publishers_of("scan")} - {simulator})
    if robot.has(SIMULATOR) and real:
        summary = f"a simulated robot, {simulator}, and a real one, {listed(real)}: the game drives both"
        remedy = "stop the simulated one (Ctrl-C) and start it in another domain"
        return bad(summary, remedy, f"{robot.start_game} --domain-id {robot.other_domain}")
    if len(bases) > 1:
        remedy = "two robots in one namespace: set another for one of them in turtlebot4-setup"
        return bad(f"{len(bases)} nodes publish {robot.full('odom')}: {listed(bases)}", remedy)
    if bases:
        return ok(f"{'simulated, ' if robot.has(SIMULATOR) else ''}{bases[0]}")
    summary = f"no publisher of {robot.full('odom')} discovered {robot.within}"
    return robot.not_yet(summary, "on the robot", RESTART)


SKEW_S = 0.2  # Nav2's layer for Clyde drops its points 0.5 s after the stamp (config/nav2.yaml)
_FEWEST, _MOST = 5, 2000  # stamps of a topic: needed, and stored
_SPAN_S = 0.5  # shortest time over which a rate is measured
_LONGEST_TURN_S = 0.5


class Clock(NamedTuple):
    """Monotonic time and content of the first message on ``/clock``, its newest content, s, and its speed."""

    first_s: float
    first_clock_s: float
    clock_s: float
    rate: float | None  # relative to monotonic time; None until known


class Stamp(NamedTuple):
    """Arrival minus stamp, s, of a message: by this machine's clock, and by ``/clock`` (None: unpublished)."""

    wall_s: float
    clock_s: float | None = None
    message: Any = None


def _add_tick(previous: Clock | None, message: Any, arrival: CheckTime) -> Clock:
    clock_s = seconds_of(message.clock)
    first_s, first_clock_s, *_ = previous or (arrival.monotonic_s, clock_s)
    span_s = arrival.monotonic_s - first_s
    return Clock(first_s, first_clock_s, clock_s, (clock_s - first_clock_s) / span_s if span_s > _SPAN_S else None)


def _add_stamps(previous: deque[Stamp] | None, message: Any, arrival: CheckTime) -> deque[Stamp]:
    stamps = deque(maxlen=_MOST) if previous is None else previous
    # Only transforms whose parent is odom: AMCL stamps the transform from the map to odom ahead.
    transforms = [one for one in getattr(message, "transforms", ()) if one.header.frame_id.lstrip("/") == "odom"]
    for one in [message] if hasattr(message, "header") else transforms:
        stamp_s = seconds_of(one.header.stamp)
        clock_s = None if arrival.clock_s is None else arrival.clock_s - stamp_s
        stamps.append(Stamp(arrival.wall_s - stamp_s, clock_s, message))
    return stamps


CLOCK = Source(topics.CLOCK, _add_tick)
STAMPS = {topic.name: Source(topic, _add_stamps) for topic in (topics.ODOMETRY, topics.SCAN, topics.TF)}


def by_clock(robot: Observations) -> bool:
    """Return True if the robot's stamps follow ``/clock``, not a wall clock."""
    clock = robot.get(CLOCK)
    if clock is None or clock.rate is None:
        return False
    stamps = [one for source in STAMPS.values() for one in robot.get(source) or ()]
    clock_s = [abs(one.clock_s) for one in stamps if one.clock_s is not None]
    if not clock_s:
        return robot.has(SIMULATOR)
    return statistics.median(clock_s) < statistics.median(abs(one.wall_s) for one in stamps)


def _check_clock(robot: Observations) -> Finding:
    owners, clock = robot.publishers_of("/clock"), robot.get(CLOCK)
    if len(owners) > 1:
        remedy = f"end all but one, or give it another domain: export ROS_DOMAIN_ID={robot.other_domain}"
        return bad(f"{len(owners)} publish /clock: {listed(owners)}", remedy)
    rate = clock and clock.rate
    if rate and by_clock(robot):
        return ok(f"simulated, by {owners[0] if owners else '/clock'}, {rate:.1f} times real time")
    if not owners:
        return ok("no node publishes /clock: nodes use the system time")
    if rate is None:
        return unknown(f"{owners[0]}: {robot.silence('/clock')}", "listen for longer: --wait 30", settled=False)
    return ok(f"{owners[0]} publishes /clock; the robot's stamps are not by it")


def _check_stamps(topic: str, robot: Observations) -> Finding | None:
    if by_clock(robot) or (robot.has(SIMULATOR) and robot.publishers_of("/clock")):
        return None  # only one clock, or ``/clock`` was not received, which another check reports
    stamps, scans = robot.get(STAMPS[topic]) or deque(), robot.get(STAMPS["scan"])
    if len(stamps) < _FEWEST:
        if topic == "scan" or (topic == "odom" and scans):
            return None  # silence of the lidar and of the base is reported by their own checks
        summary = f"{count(len(stamps), 'stamp')} received {robot.within}" if stamps else robot.silence(topic)
        if topic == "odom" and robot.publishers_of(topic) and not stamps:
            remedy = "its publisher is discovered, but no message arrives: a firewall may pass only discovery"
            return bad(summary, remedy, FIREWALL, settled=False)
        return unknown(summary, "see base and tf to base", settled=False)
    late_s = statistics.median(one.wall_s for one in stamps)
    side = "behind" if late_s >= 0 else "ahead of"
    summary = f"{abs(late_s):.2f} s {side} this machine's clock (median of {len(stamps)})"
    turn_s = getattr(stamps[-1].message, "scan_time", 0.0)  # a scan is stamped at its start
    if -SKEW_S <= late_s <= SKEW_S + (min(turn_s, _LONGEST_TURN_S) if turn_s > 0 else 0.0):  # also refuses NaN
        return ok(summary)
    if topic != "scan" and scans and abs(statistics.median(one.wall_s for one in scans)) < SKEW_S:
        remedy = "the base's own clock is off: its web page (port 8080 of the robot), Beta Features, Restart ntpd"
        return bad(summary, remedy)
    remedy = "synchronise the clocks by NTP (apt install chrony), on robot and this machine"
    return bad(f"{summary}; costmaps drop Clyde from {SKEW_S:g} s on", remedy, "sudo chronyc makestep")


CHECKS = (
    Check("ROS", "Which nodes can be discovered from here?", _check_ros, needs_robot=False),
    Check("domain", "Is any node in the ROS domain?", _check_domain, needs_robot=False),
    Check("namespace", "Are nodes in the robot's namespace?", _check_namespace, needs_robot=False),
    Check("base", "Does exactly one robot publish odometry?", _check_base),
    Check("clock", "Is there one simulated clock at most?", _check_clock, (CLOCK, *STAMPS.values()), False),
    *(
        Check(
            f"time of {name}", f"Do the stamps of {name} agree with this machine's clock?", partial(_check_stamps, name)
        )
        for name in STAMPS
    ),
)
