"""What is to be said of a robot before it plays: evidence to findings, each with its cure. Imports nothing of ROS.

``doctor.py`` gathers the evidence. A finding is ``ok``, ``BAD``, or ``-``: it cannot be told, or does not apply.
What was not heard is said to be not heard within the time, for nobody knows that it is not there.
"""

from __future__ import annotations

import math
import statistics
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import differences
from pacman_env.ros.discovery import COSTMAPS
from pacman_env.ros.supervisor.game_nodes import GAME, REFEREE, SELECTOR, SIMULATOR
from pacman_env.world.maps.occupancy import OccupancyMap

OK, BAD, UNKNOWN = "ok", "BAD", "-"

SKEW_S = 0.2  # Nav2's layer for Clyde keeps him for 0.5 s after the stamp (config/nav2.yaml)
FRESH_S = 1.0  # of a transform; the goal selector's pose_timeout_s
SLOWEST_SCAN_HZ = 4.0  # the RPLIDAR turns 5 to 10 times a second
FEWEST_SCANS = 3
FEWEST_RETURNS = 0.1  # share of rays; less is a lidar that is covered
FLAT = 0.2  # charge at which a TurtleBot 4 warns; it switches itself off at 0.12
FEWEST_STAMPS = 5
CELLS_DIFFER = 0.001  # share; the same file gives 0
LIDAR_FRAME = "rplidar_link"  # of the TurtleBot 4, as long as no scan names another
CLOUDS = ("clyde_obstacle", "clyde_trail")
#: Nodes that Nav2's launch files for Jazzy bring up by these two managers (nav2_bringup 1.3.13, f4108e5).
MANAGERS: Mapping[str, tuple[str, ...]] = {
    "lifecycle_manager_localization": ("map_server", "amcl"),
    "lifecycle_manager_navigation": (
        *("controller_server", "smoother_server", "planner_server", "route_server", "behavior_server"),
        *("velocity_smoother", "collision_monitor", "bt_navigator", "waypoint_follower", "docking_server"),
    ),
}
ORIGINAL_SELECTOR = "planner_stub"
#: Beside the domain, what decides in the environment whom a node can meet.
VARIABLES = (
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_LOCALHOST_ONLY",
    "ROS_DISCOVERY_SERVER",
    "ROS_SUPER_CLIENT",
    "ROS_STATIC_PEERS",
    "RMW_IMPLEMENTATION",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
)
_LISTED = 5  # names in one finding
_LONGEST = 300  # characters of what was seen
_TRUE = ("1", "true", "yes", "on")
_EMPTY: Mapping[str, Any] = {}


@dataclass(frozen=True)
class Finding:
    """One line of the list.

    Attributes:
        check: what was looked at.
        mark: ``OK``, ``BAD`` or ``UNKNOWN``.
        seen: with figures and units.
        cure: what to do about it, empty where there is nothing to do.
        command: the one command of the cure, if it is a command.
        heard: False while listening on may change it.
    """

    check: str
    mark: str
    seen: str
    cure: str = ""
    command: str = ""
    heard: bool = True


@dataclass(frozen=True)
class Delays:
    """Clock at arrival less stamp, s, of the messages of one topic: by this machine's clock, and by ``/clock``."""

    wall_s: tuple[float, ...] = ()
    clock_s: tuple[float, ...] = ()


@dataclass(frozen=True)
class Grid:
    """A map as it was heard; ``cells`` (H, W), row 0 is the lowest."""

    resolution: float
    origin: tuple[float, float, float]
    cells: NDArray[np.int8]


@dataclass(frozen=True)
class Scans:
    """What the lidar said: rate by its stamps (Hz), share of rays with a return, ranges (m), one turn (s)."""

    count: int
    rate_hz: float
    returns: float
    least_m: float
    most_m: float
    frame: str
    turn_s: float


@dataclass(frozen=True)
class Link:
    """A frame's parent, and how long ago that was heard last, s; None: it is static."""

    parent: str
    age_s: float | None


@dataclass(frozen=True)
class Evidence:
    """All that was heard of a robot. Names of nodes are full, those of topics relative.

    Attributes:
        namespace: with its slash.
        waited_s: for how long was listened at most.
        domain: ROS domain.
        simulated: a simulated robot was asked for.
        map: the game's map.
        map_file: how it was named.
        environment: the variables of :data:`VARIABLES` that are set.
        middleware: its name.
        nodes: all others in the domain.
        robots: namespaces in which a base tells its odometry.
        publishers: nodes by topic; ``/clock`` is among the topics.
        subscribers: nodes by topic.
        misheard: by topic, other names at which costmaps listen instead.
        delays: by topic, of what is stamped by the robot's clocks.
        clock_rate: of ``/clock``, in wall time; None: not heard.
        grid: of the topic ``map``.
        pose: the last ``amcl_pose``, x, y, heading.
        pose_age_s: since its stamp, by the robot's clock.
        links: by child frame.
        scans: of the lidar.
        docked: whether.
        charge: of the battery, 0 to 1.
        navigators: nodes that serve ``navigate_to_pose``.
        managers: what Nav2's lifecycle managers answered; None: nothing.
        states: by name of a node in the namespace, its lifecycle state.
        configurations: of the game's nodes, parsed.
        state: of the game.
        condition: the goal selector's diagnostics, parsed.
        unavailable: by topic, why it cannot be listened to.
        unreadable: by topic, what was wrong with messages.
    """

    namespace: str
    waited_s: float
    domain: int = 0
    simulated: bool = False
    map: OccupancyMap | None = None
    map_file: str = ""
    environment: Mapping[str, str] = field(default_factory=dict)
    middleware: str = ""
    nodes: tuple[str, ...] = ()
    robots: tuple[str, ...] = ()
    publishers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    subscribers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    misheard: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    delays: Mapping[str, Delays] = field(default_factory=dict)
    clock_rate: float | None = None
    grid: Grid | None = None
    pose: tuple[float, float, float] | None = None
    pose_age_s: float | None = None
    links: Mapping[str, Link] = field(default_factory=dict)
    scans: Scans | None = None
    docked: bool | None = None
    charge: float | None = None
    navigators: tuple[str, ...] = ()
    managers: Mapping[str, bool | None] = field(default_factory=dict)
    states: Mapping[str, str] = field(default_factory=dict)
    configurations: tuple[Mapping[str, Any], ...] = ()
    state: str | None = None
    condition: Mapping[str, Any] | None = None
    unavailable: Mapping[str, str] = field(default_factory=dict)
    unreadable: Mapping[str, str] = field(default_factory=dict)

    def full(self, name: str) -> str:
        """A relative name in the robot's namespace."""
        return f"{self.namespace.rstrip('/')}/{name}"

    @property
    def own(self) -> tuple[str, ...]:
        """Nodes in the robot's namespace."""
        return tuple(name for name in self.nodes if name.startswith(self.full("")))

    @property
    def in_simulation(self) -> bool:
        """Whether the project's simulated robot is there."""
        return self.full(SIMULATOR) in self.nodes

    @property
    def virtual(self) -> bool:
        """Whether a simulated robot is there, or should be."""
        return self.simulated or self.in_simulation

    @property
    def by_clock(self) -> bool:
        """Whether the robot's stamps are those of ``/clock``, not of a clock on a wall."""
        if self.clock_rate is None:
            return False
        wall = [abs(s) for delays in self.delays.values() for s in delays.wall_s]
        clock = [abs(s) for delays in self.delays.values() for s in delays.clock_s]
        if not wall or not clock:
            return self.in_simulation
        return statistics.median(clock) < statistics.median(wall)

    def launch(self, file: str, more: str) -> str:
        """The command that launches a file of turtlebot4_navigation for this robot."""
        namespace = f" namespace:={self.namespace}" if self.namespace != "/" else ""
        return f"ros2 launch turtlebot4_navigation {file}.launch.py{namespace} {more}"

    def localize(self) -> str:
        """The command that starts localization on the game's map."""
        file = self.map_file or "$PWD/home.yaml"
        return self.launch("localization", f"map:={file if file.endswith('.yaml') else f'$PWD/maps/{file}.yaml'}")

    def up(self) -> str:
        """The command that starts the game."""
        sim = " --sim" if self.virtual else ""
        where = self.namespace.strip("/") or "/"
        return f"pacman-env ros up --map {self.map_file or 'FILE_OR_NAME'} --namespace {where}{sim}"

    def silence(self, topic: str) -> str:
        """Why there is nothing of a topic, as far as is known."""
        if topic in self.unavailable:
            return self.unavailable[topic]
        if topic in self.unreadable:
            return f"{topic} cannot be used: {self.unreadable[topic]}"
        return f"{topic} not heard within {self.waited_s:g} s"


def find(evidence: Evidence) -> list[Finding]:
    """All findings, in the order in which they are to be cured."""
    if not evidence.own:
        rest = Finding("robot", UNKNOWN, "nothing else can be looked at without one", "see above", heard=False)
        return [found for check in (_environment, _anybody, _namespace, _clock) for found in check(evidence)] + [rest]
    checks = (
        *(
            _environment,
            _anybody,
            _namespace,
            _base,
            _clock,
            _stamps,
            _dock,
            _battery,
            _lidar,
            _map,
            _pose,
            _base_frames,
        ),
        *(_lidar_frames, _navigator, _lifecycle, _clouds, _game_nodes, _configuration, _game),
    )
    return [found for check in checks for found in check(evidence)]


# ROS itself


def _environment(e: Evidence) -> Iterable[Finding]:
    local = e.environment.get("ROS_LOCALHOST_ONLY", "0").lower() in _TRUE
    reach = "LOCALHOST" if local else e.environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET").upper()
    ways = {"LOCALHOST": "this machine only", "OFF": "nobody", "SUBNET": "this machine and its network"}
    told = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY")
    more = [f"{name}={value}" for name, value in e.environment.items() if name not in told]
    missing = [name for name in ("ROS_DISCOVERY_SERVER", "RMW_IMPLEMENTATION") if name not in e.environment]
    seen = "; ".join(
        [
            f"domain {e.domain}, {e.middleware or 'unknown middleware'}, sees {ways.get(reach, reach)}",
            *more,
            *([f"not set: {', '.join(missing)}"] if missing else []),
        ]
    )
    if reach == "OFF":
        yield Finding("ROS", BAD, seen, "let it see others", "export ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET")
    elif "ROS_DISCOVERY_SERVER" in e.environment and e.environment.get("ROS_SUPER_CLIENT", "").lower() not in _TRUE:
        cure = "with a discovery server only a super client sees all nodes"
        yield Finding("ROS", UNKNOWN, seen, cure, "export ROS_SUPER_CLIENT=True")
    else:
        yield Finding("ROS", OK, seen)


def _anybody(e: Evidence) -> Iterable[Finding]:
    if e.nodes:
        yield Finding("domain", OK, f"{_count(len(e.nodes), 'node')} heard in domain {e.domain}")
        return
    if e.simulated:
        cure, command = "start the simulated game in this domain", e.up()
    else:
        cure = (
            "robot and this machine: one network, one ROS_DOMAIN_ID (turtlebot4-setup on the robot), no firewall; "
            "where a network drops multicast, the discovery server of turtlebot4-setup"
        )
        if e.environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper() == "LOCALHOST":
            cure = f"unset ROS_AUTOMATIC_DISCOVERY_RANGE, which is LOCALHOST; {cure}"
        command = "sudo ufw allow proto udp from 192.168.0.0/16"
    seen = f"no node heard in domain {e.domain} within {e.waited_s:g} s"
    yield Finding("domain", BAD, seen, cure, command, heard=False)


def _namespace(e: Evidence) -> Iterable[Finding]:
    if e.own:
        yield Finding("namespace", OK, f"{_count(len(e.own), 'node')} in {e.namespace}")
        return
    seen = f"no node heard in {e.namespace} within {e.waited_s:g} s"
    if not e.nodes:
        yield Finding("namespace", UNKNOWN, seen, heard=False)
        return
    others = list(e.robots) or sorted({name.rpartition("/")[0] or "/" for name in e.nodes})
    seen += f"; others in {_listed(others)}"
    nearest = others[0].strip("/") or "/"
    cure = f"did you mean --namespace {nearest}? else set the robot's in turtlebot4-setup"
    yield Finding("namespace", BAD, seen, cure, heard=False)


# The robot


def _base(e: Evidence) -> Iterable[Finding]:
    simulator = e.full(SIMULATOR)
    tells = sorted({who for topic in ("odom", "scan") for who in e.publishers.get(topic, ()) if who != simulator})
    bases = e.publishers.get("odom", ())
    if e.in_simulation and tells:
        seen = f"a simulated robot, {simulator}, and a real one, {_listed(tells)}: the game drives both"
        cure = "stop the simulated one (Ctrl-C) and start it in a domain of its own"
        yield Finding("base", BAD, seen, cure, f"{e.up().removesuffix(' --sim')} --sim --domain-id {_other(e.domain)}")
    elif len(bases) > 1:
        seen = f"{len(bases)} tell {e.full('odom')}: {_listed(bases)}"
        cure = "two robots in one namespace: set another for one of them in turtlebot4-setup"
        yield Finding("base", BAD, seen, cure)
    elif bases:
        yield Finding("base", OK, f"{'simulated, ' if e.in_simulation else ''}{bases[0]}")
    else:
        seen = f"nobody heard to publish {e.full('odom')} within {e.waited_s:g} s"
        cure, command = "on the robot", "sudo systemctl restart turtlebot4"
        if e.simulated:
            cure, command = "start a simulated robot", e.up()
        yield Finding("base", BAD, seen, cure, command, heard=False)


def _clock(e: Evidence) -> Iterable[Finding]:
    owners = e.publishers.get("/clock", ())
    if len(owners) > 1:
        cure = f"end all but one, or give it another domain: export ROS_DOMAIN_ID={_other(e.domain)}"
        yield Finding("clock", BAD, f"{len(owners)} publish /clock: {_listed(owners)}", cure)
    elif e.by_clock:
        seen = f"simulated, by {owners[0] if owners else '/clock'}, {e.clock_rate or 0.0:.1f} times as fast as time"
        yield Finding("clock", OK, seen)
    elif owners:
        if e.clock_rate is None:
            seen = f"{owners[0]}: {e.silence('/clock')}"
            yield Finding("clock", UNKNOWN, seen, "listen for longer: --wait 30", heard=False)
        else:
            yield Finding("clock", OK, f"{owners[0]} publishes /clock; the robot's stamps are not by it")
    else:
        yield Finding("clock", OK, "nobody publishes /clock: time is that on the wall")


def _stamps(e: Evidence) -> Iterable[Finding]:
    if e.by_clock:
        return  # one clock for all
    if e.in_simulation and e.publishers.get("/clock"):
        return  # its time has not been heard yet, and that is said already
    for topic in ("odom", "scan", "tf"):
        check, delays = f"time of {topic}", e.delays.get(topic, Delays()).wall_s
        if len(delays) < FEWEST_STAMPS:
            seen = f"{_count(len(delays), 'stamp')} heard within {e.waited_s:g} s" if delays else e.silence(topic)
            if topic == "scan":
                continue  # a silent lidar has a line of its own
            if topic in e.unavailable:
                yield Finding(check, UNKNOWN, seen, *_about(e, topic), heard=False)
            elif topic == "odom" and e.publishers.get(topic) and not delays:
                cure = "its publisher is known, but nothing arrives: a firewall that lets only discovery through?"
                yield Finding(check, BAD, seen, cure, _FIREWALL, heard=False)
            else:
                yield Finding(check, UNKNOWN, seen, "see base and tf to base", heard=False)
            continue
        late_s = statistics.median(delays)
        side = "behind" if late_s >= 0 else "ahead of"
        seen = f"{abs(late_s):.2f} s {side} this machine's clock (median of {len(delays)})"
        turn_s = e.scans.turn_s if topic == "scan" and e.scans is not None else 0.0
        if -SKEW_S <= late_s <= SKEW_S + turn_s:  # a scan is stamped when it begins
            yield Finding(check, OK, seen)
            continue
        cure = "synchronise the clocks by NTP (apt install chrony), on robot and this machine"
        if (
            topic != "scan"
            and "scan" in e.delays
            and abs(statistics.median(e.delays["scan"].wall_s or (0.0,))) < SKEW_S
        ):
            cure = "the base's own clock is off: its web page (port 8080 of the robot), Beta Features, Restart ntpd"
            yield Finding(check, BAD, seen, cure)
            continue
        yield Finding(check, BAD, f"{seen}; costmaps drop Clyde from {SKEW_S:g} s on", cure, "sudo chronyc makestep")


_FIREWALL = "sudo ufw allow proto udp from 192.168.0.0/16"


def _dock(e: Evidence) -> Iterable[Finding]:
    if e.virtual:
        yield Finding("dock", UNKNOWN, "a simulated robot has none")
    elif e.docked is None:
        yield Finding("dock", UNKNOWN, e.silence("dock_status"), *_about(e, "dock_status"), heard=False)
    elif e.docked:
        undock = f'ros2 action send_goal {e.full("undock")} irobot_create_msgs/action/Undock "{{}}"'
        yield Finding("dock", BAD, "docked, where a TurtleBot 4 stops its lidar", "undock, a metre free behind", undock)
    else:
        yield Finding("dock", OK, "undocked")


def _battery(e: Evidence) -> Iterable[Finding]:
    if e.virtual:
        yield Finding("battery", UNKNOWN, "a simulated robot has none")
    elif e.charge is None:
        yield Finding("battery", UNKNOWN, e.silence("battery_state"), *_about(e, "battery_state"), heard=False)
    elif e.charge < FLAT:
        dock = f'ros2 action send_goal {e.full("dock")} irobot_create_msgs/action/Dock "{{}}"'
        cure, command = ("leave it on its dock", "") if e.docked else ("charge it, within sight of its dock", dock)
        yield Finding("battery", BAD, f"{100 * e.charge:.0f} %, less than {100 * FLAT:.0f} %", cure, command)
    else:
        yield Finding("battery", OK, f"{100 * e.charge:.0f} %")


def _about(e: Evidence, topic: str) -> tuple[str, str]:
    """What to do about something that is not heard, but may be said rarely."""
    if topic in e.unavailable:
        return "source /opt/ros/jazzy/setup.bash; without a ROS installation", _BUILD
    return "some bases say it rarely: listen for longer, --wait 60", ""


_BUILD = "python -m tools.ros_interfaces.build"


def _lidar(e: Evidence) -> Iterable[Finding]:
    scans = e.scans
    if scans is None or scans.count < FEWEST_SCANS:
        motor = f'ros2 service call {e.full("start_motor")} std_srvs/srv/Empty "{{}}"'
        cure, command = ("undock: a docked TurtleBot 4 stops it", "") if e.docked else ("start its motor", motor)
        if e.virtual:
            cure, command = "the simulated robot tells it: start the game again", e.up()
        elif "scan" in e.unreadable:
            cure, command = "look at its driver's log", ""
        seen = e.silence("scan") if scans is None else f"{_count(scans.count, 'scan')} within {e.waited_s:g} s"
        yield Finding("lidar", BAD, seen, cure, command, heard=False)
        return
    ranges = f", {scans.least_m:.2f} to {scans.most_m:.2f} m" if scans.returns > 0 else ""
    seen = f"{scans.rate_hz:.1f} Hz, {100 * scans.returns:.0f} % of rays return{ranges}"
    if scans.returns < FEWEST_RETURNS:
        yield Finding("lidar", BAD, seen, "is something on it, or is it covered? free it")
    elif scans.rate_hz < SLOWEST_SCAN_HZ and not e.by_clock:
        cure = f"less than {SLOWEST_SCAN_HZ:g} Hz arrive: a nearer access point, or run the game on the robot"
        yield Finding("lidar", BAD, seen, cure)
    else:
        yield Finding("lidar", OK, seen)


# Where it is


def _map(e: Evidence) -> Iterable[Finding]:
    grid, game = e.grid, e.map
    if grid is None:
        cure, command = "start localization with the game's map", e.localize()
        if e.virtual:
            cure, command = "the simulated robot shows its map: start the game", e.up()
        yield Finding("map", BAD, e.silence("map"), cure, command, heard=False)
        return
    rows, columns = grid.cells.shape
    seen = f"{columns} x {rows} cells of {grid.resolution:.3g} m"
    if game is None:
        yield Finding("map", UNKNOWN, f"{seen}; not compared", "name the game's: --map FILE_OR_NAME")
        return
    wrong = []
    if (columns, rows) != (game.width, game.height):
        wrong.append(f"size {columns} x {rows}, here {game.width} x {game.height}")
    if not math.isclose(grid.resolution, game.resolution, rel_tol=1e-4):
        wrong.append(f"cells of {grid.resolution:.4g} m, here {game.resolution:.4g} m")
    if not all(math.isclose(a, b, abs_tol=1e-3) for a, b in zip(grid.origin, game.origin, strict=True)):
        theirs, ours = (f"({x:.2f}, {y:.2f}, {yaw:.2f})" for x, y, yaw in (grid.origin, game.origin))
        wrong.append(f"origin {theirs}, here {ours}")
    if not wrong:
        share = float(np.mean(np.flipud(grid.cells) != game.occupancy))
        if share > CELLS_DIFFER:
            wrong.append(f"{100 * share:.1f} % of cells differ")
        seen += f", {100 * share:.1f} % differ from {game.name}"
    if wrong:
        seen = f"not {game.name}: {'; '.join(wrong)}"
        cure = "localization and game need one file: start one of them again with the other's"
        yield Finding("map", BAD, seen, cure, "" if e.in_simulation else e.localize())
    else:
        yield Finding("map", OK, seen)


def _pose(e: Evidence) -> Iterable[Finding]:
    estimate = 'give the initial pose: RViz, "2D Pose Estimate", click where it stands, drag to where it looks'
    if e.pose is None:
        localized = e.in_simulation or e.full("amcl") in e.nodes or e.publishers.get("amcl_pose")
        if localized:
            yield Finding("pose", BAD, f"{e.silence('amcl_pose')}: no initial pose yet", estimate, heard=False)
        else:
            cure = "no amcl heard either: start localization"
            command = e.up() if e.simulated else e.localize()
            yield Finding("pose", BAD, e.silence("amcl_pose"), cure, command, heard=False)
        return
    x, y, heading = e.pose
    age = "" if e.pose_age_s is None else f", {e.pose_age_s:.1f} s old"  # standing still AMCL is silent
    seen = f"({x:.2f}, {y:.2f}) m, {math.degrees(heading):.0f} degrees{age}"
    cells = e.map.occupancy if e.map is not None else None
    if cells is not None and e.map is not None:
        column, row = (round(float(v)) for v in e.map.world_to_cell(x, y))
        inside = 0 <= column < e.map.width and 0 <= row < e.map.height
        cell = int(cells[row, column]) if inside else None
        where = {None: "off the map", 100: "in a wall", -1: "where the map knows nothing"}.get(cell)
        if where is not None:
            yield Finding("pose", BAD, f"{seen}: {where}", f"wrong map, or {estimate}")
            return
        seen += ", on free floor"
    yield Finding("pose", OK, seen)


def _base_frames(e: Evidence) -> Iterable[Finding]:
    way, ages = _climb(e, "base_link", "map")
    if way[-1] != "map":
        loose = way[-1]
        yield Finding("tf to base", BAD, f"{_silence_of_frame(e, 'tf', loose)}", *_mender(e, loose), heard=False)
        return
    oldest = max(ages, key=lambda child: ages[child], default=None)
    if oldest is not None and ages[oldest] > FRESH_S:
        seen = f"{e.links[oldest].parent} > {oldest} is {ages[oldest]:.1f} s old, more than {FRESH_S:g} s"
        yield Finding("tf to base", BAD, seen, *_mender(e, oldest, stale=True), heard=False)
        return
    age = f", {ages[oldest]:.2f} s old at most" if oldest is not None else ""
    yield Finding("tf to base", OK, f"{' > '.join(reversed(way))}{age}")


def _lidar_frames(e: Evidence) -> Iterable[Finding]:
    frame = e.scans.frame if e.scans is not None else LIDAR_FRAME
    way, _ = _climb(e, frame, "base_link")
    if way[-1] == "base_link":
        yield Finding("tf to lidar", OK, " > ".join(reversed(way)))
    else:
        seen = _silence_of_frame(e, "tf_static", way[-1])
        cure, command = "the robot's description is not told; on the robot", "sudo systemctl restart turtlebot4"
        if e.virtual:
            cure, command = "the simulated robot tells it: start the game again", e.up()
        yield Finding("tf to lidar", BAD, seen, cure, command, heard=False)


def _climb(e: Evidence, frame: str, top: str) -> tuple[list[str], dict[str, float]]:
    """The frames on the way up as far as it goes, and the ages of the links that are not static."""
    way, ages = [frame], {}
    while frame != top and frame in e.links and len(way) <= len(e.links):
        link = e.links[frame]
        if link.age_s is not None:
            ages[frame] = link.age_s
        frame = link.parent
        way.append(frame)
    return way, ages


def _silence_of_frame(e: Evidence, topic: str, frame: str) -> str:
    if topic in e.unavailable or topic in e.unreadable:
        return e.silence(topic)
    return f"no parent of {frame} heard on {e.full(topic)} within {e.waited_s:g} s"


def _mender(e: Evidence, child: str, stale: bool = False) -> tuple[str, str]:
    """Who is to tell where a frame is."""
    if "tf" in e.unavailable:
        return _about(e, "tf")
    if child == "odom":
        if stale:
            return "AMCL tells it with every scan: see lidar and dock", ""
        return "AMCL tells it when it has an initial pose and scans: see pose and lidar", ""
    if e.virtual:
        return "the simulated robot tells it: start the game again", e.up()
    return "the base tells it; on the robot", "sudo systemctl restart turtlebot4"


# Nav2


def _nav2(e: Evidence) -> str:
    return e.launch("nav2", "params_file:=$PWD/config/nav2.yaml")


def _navigator(e: Evidence) -> Iterable[Finding]:
    servers = e.navigators
    if len(servers) > 1:
        seen = f"{len(servers)} serve navigate_to_pose: {_listed(servers)}"
        yield Finding("Nav2", BAD, seen, "end all but one: each goal goes to both")
    elif servers:
        yield Finding("Nav2", OK, f"navigate_to_pose is served by {servers[0]}")
    else:
        seen = f"no server of navigate_to_pose heard within {e.waited_s:g} s"
        cure, command = ("start the game again", e.up()) if e.virtual else ("start Nav2", _nav2(e))
        yield Finding("Nav2", BAD, seen, cure, command, heard=False)


def _lifecycle(e: Evidence) -> Iterable[Finding]:
    if e.virtual:
        yield Finding("Nav2's nodes", UNKNOWN, "simulated: they are not there, and not needed")
        return
    known = [name for names in MANAGERS.values() for name in names]
    asleep = [f"{name} is {e.states[name]}" for name in known if e.states.get(name, "active") != "active"]
    refused = [name for name in MANAGERS if e.managers.get(name) is False]
    silent = [name for name in MANAGERS if e.managers.get(name) is None]
    if refused or asleep:
        seen = _listed([*(f"{name} is not active" for name in refused), *asleep])
        manager = refused[0] if refused else next(m for m, names in MANAGERS.items() if asleep[0].split()[0] in names)
        service = e.full(f"{manager}/manage_nodes")
        command = f'ros2 service call {service} nav2_msgs/srv/ManageLifecycleNodes "{{command: 0}}"'
        yield Finding("Nav2's nodes", BAD, seen, "start them up; the launch file's log says why they were not", command)
    elif silent:
        active = [name for name in known if e.states.get(name) == "active"]
        seen = f"{' and '.join(silent)} not heard within {e.waited_s:g} s; active: {_listed(active) or 'none heard'}"
        command = _nav2(e) if silent == ["lifecycle_manager_navigation"] else e.localize()
        yield Finding("Nav2's nodes", UNKNOWN, seen, "if it does not run, start it", command, heard=False)
    else:
        active = [name for name in known if e.states.get(name) == "active"]
        yield Finding(
            "Nav2's nodes", OK, f"localization and navigation are active: {_listed(active)}".removesuffix(": ")
        )


def _clouds(e: Evidence) -> Iterable[Finding]:
    for topic in CLOUDS:
        hearers = e.subscribers.get(topic, ())
        if e.virtual:
            if e.full(SIMULATOR) in hearers:
                yield Finding(topic, OK, f"{e.full(SIMULATOR)} hears it, in place of the costmaps")
            elif topic == CLOUDS[0]:
                seen = f"{e.full(SIMULATOR)} not heard to listen within {e.waited_s:g} s"
                yield Finding(topic, BAD, seen, "start the simulated game again", e.up(), heard=False)
            else:
                yield Finding(topic, UNKNOWN, "simulated: what Clyde leaves behind is cleared without it")
            continue
        deaf = [name for name in COSTMAPS if e.full(f"{name}/{name}") not in hearers]
        if not deaf:
            yield Finding(topic, OK, "heard by local_costmap and global_costmap")
            continue
        seen = f"{' and '.join(deaf)} not heard to listen within {e.waited_s:g} s"
        if e.misheard.get(topic):
            seen += f", but at {_listed(e.misheard[topic])}, where nobody speaks"
        cure = "Nav2 does not see Clyde: launch it with the game's config/nav2.yaml, from the checkout"
        yield Finding(topic, BAD, seen, cure, _nav2(e), heard=False)


# The game


def _game_nodes(e: Evidence) -> Iterable[Finding]:
    wanted = [*((SIMULATOR,) if e.virtual else ()), *GAME, SELECTOR]
    here = {name for name in wanted if e.full(name) in e.nodes}
    if e.full(ORIGINAL_SELECTOR) in e.nodes:
        here.add(SELECTOR)
    absent = [name for name in wanted if name not in here]
    twice = _rivals(e)
    if twice:
        cure = "end all but one: Ctrl-C in the terminal of the other ros up or ros2 launch"
        yield Finding("game's nodes", BAD, "; ".join(twice), cure)
    elif not absent:
        yield Finding("game's nodes", OK, f"all {len(wanted)} are there")
    elif here - {SIMULATOR}:
        seen = f"{len(here)} of {len(wanted)}; not heard within {e.waited_s:g} s: {_listed(absent)}"
        cure = "Ctrl-C in the game's terminal, then start it again; its log says why a node ended"
        if absent == [SELECTOR]:
            cure = f"it starts when the robot has a pose; else {cure}"
        yield Finding("game's nodes", BAD, seen, cure, e.up(), heard=False)
    else:
        yield Finding("game's nodes", UNKNOWN, "none yet", "when all else is ok", e.up(), heard=False)


def _rivals(e: Evidence) -> list[str]:
    """Nodes of one kind of which only one may act, and as which processes they run."""
    found: dict[str, list[str]] = {}
    for plays in e.configurations:
        if plays["acts"]:
            _, host, number = plays["started"]
            found.setdefault(plays["node"], []).append(f"process {number} on {host}")
    return [f"{name} runs {len(who)} times: {_listed(who)}" for name, who in sorted(found.items()) if len(who) > 1]


def _configuration(e: Evidence) -> Iterable[Finding]:
    said = sorted(e.configurations, key=lambda plays: (plays["node"] != REFEREE, plays["node"]))
    if not said:
        heard = not any(e.full(name) in e.nodes for name in GAME)
        seen = "no node of the game to compare" if heard else e.silence("game/configuration")
        cure = "" if heard else "are these the original's nodes? they tell none"
        yield Finding("configuration", UNKNOWN, seen, cure, heard=heard)
        return
    first, wrong = said[0], []
    for plays in said[1:]:
        fields = differences(plays["configuration"], first["configuration"])
        if fields:
            words = [f"{name} {there}, there {here}" for name, (there, here) in fields.items()]
            wrong.append(f"{plays['node']} plays by {_listed(words)}")
        elif plays["hash"] != first["hash"]:
            wrong.append(f"{plays['node']} plays by {plays['hash']}, {first['node']} by {first['hash']}")
    maps = {str(plays["node"]): str(plays["map"]) for plays in said if plays["map"] is not None}
    ours = e.map.hash[:12] if e.map is not None else next(iter(maps.values()), None)
    whose = f"map {e.map.name}" if e.map is not None else f"{next(iter(maps), '')}'s map"
    others = [f"{node} plays on {there}, {whose} is {ours}" for node, there in maps.items() if there != ours]
    if wrong or others:
        reference = f" (there: {first['node']})" if wrong else ""
        cure = "start all nodes with the same --map, --preset, --execution and --set"
        yield Finding("configuration", BAD, _listed([*wrong, *others]) + reference, cure, e.up())
    else:
        on = f" on map {ours}" if maps else ""
        yield Finding("configuration", OK, f"{_count(len(said), 'node')} by {first['hash']}{on}")


def _game(e: Evidence) -> Iterable[Finding]:
    condition = e.condition or _EMPTY
    if e.state is None and not condition:
        expected = e.full(REFEREE) in e.nodes or e.full(SELECTOR) in e.nodes
        seen = e.silence("game_state") if expected else "no game goes on"
        cure = "wait for it: the first start compiles for a minute" if expected else ""
        yield Finding("game", UNKNOWN, seen, cure, heard=not expected)
        return
    policy = condition.get("policy")
    parts = [
        e.state or e.silence("game_state"),
        f"policy {policy}" if policy is not None else e.silence("goal_selector/diagnostics"),
        *(["the goal selector is not active"] if condition.get("active") is False else []),
        *(["it does not hear Nav2"] if condition.get("nav2") is False else []),
    ]
    troubles = condition.get("troubles")
    counted = [f"{name} ({count})" for name, count in troubles.items()] if isinstance(troubles, Mapping) else []
    if counted:
        parts.append(f"troubles: {_listed(counted)}")
    heard = e.state is not None and policy is not None
    cure = "its log says more: goal_selector.log in the folder that ros up names" if counted else ""
    if len(parts) > 2 or not heard:
        yield Finding("game", UNKNOWN, ", ".join(parts), cure or "see the lines above", heard=heard)
    else:
        yield Finding("game", OK, ", ".join(parts))


# The list


def is_ready(findings: Iterable[Finding]) -> bool:
    """Whether nothing is BAD."""
    return all(found.mark != BAD for found in findings)


def render(findings: Sequence[Finding], title: str, width: int = 80) -> str:
    """The list as lines of at most ``width`` columns, but for commands, which stay whole."""
    indent = max(len(found.check) for found in findings) + 6
    lines = [title]
    for found in findings:
        head = f"{found.mark:<4}{found.check:<{indent - 4}}"
        lines += textwrap.wrap(
            _plain(found.seen), width, initial_indent=head, subsequent_indent=" " * indent, break_on_hyphens=False
        )
        if found.cure or found.command:
            words = f"-> {_plain(found.cure)}{':' if found.cure and found.command else ''}".rstrip()
            space = " " * indent
            lines += textwrap.wrap(
                words,
                width,
                initial_indent=space,
                subsequent_indent=f"{space}   ",
                break_on_hyphens=False,
                break_long_words=False,
            )
            if found.command:
                command = _plain(found.command)
                fits = max(width - len(command), 4)
                lines.append(" " * min(indent + 3, fits) + command)
    bad = [found.check for found in findings if found.mark == BAD]
    last = f"{len(bad)} of {len(findings)} BAD: {', '.join(bad)}" if bad else "nothing is BAD"
    return "\n".join([*lines, *textwrap.wrap(last, width)])


def _plain(text: str) -> str:
    """Without what a terminal would obey, and on one line: names and words come from other machines."""
    words = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return words if len(words) <= _LONGEST else f"{words[: _LONGEST - 3]}..."


def _listed(names: Iterable[str]) -> str:
    found = list(names)
    more = f" and {len(found) - _LISTED} more" if len(found) > _LISTED else ""
    return ", ".join(found[:_LISTED]) + more


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _other(domain: int) -> int:
    """Another domain."""
    return domain + 1 if domain < 101 else 1
