"""Base of all checks: a check answers a question about a robot from observations.

A new check is a function in one of this folder's files, and an entry in ``CHECKS`` at the end of that file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Generic, NamedTuple, TypeVar

from pacman_env.world.maps.occupancy import OccupancyMap

from ...game_nodes import SIMULATOR
from ...topics import Service, Topic

OK, BAD, UNKNOWN = "ok", "BAD", "-"
FIREWALL = "sudo ufw allow proto udp from 192.168.0.0/16"  # FIREWALL and RESTART are commands of remedies
RESTART = "sudo systemctl restart turtlebot4"
RESTART_GAME = "start or restart the simulated game"
_LISTED = 5  # most names in one summary
_NAV2_LOG = (
    "Nav2 is not up yet, or has ended: read nav2.log in the folder that ros up prints; with --nav2 none, start it with "
    "the command that is printed there"
)

T = TypeVar("T")


@dataclass(frozen=True)
class Finding:
    check: str  # name of the check; ``Check.find`` sets name and question
    question: str
    status: str  # OK, BAD or UNKNOWN: the question cannot be answered, or does not apply
    summary: str  # observation with figures and units
    remedy: str = ""
    command: str = ""  # command of the remedy, if it consists of one
    settled: bool = True  # False if more time may change it


ok, bad, unknown = (partial(Finding, "", "", status) for status in (OK, BAD, UNKNOWN))


class CheckTime(NamedTuple):
    """A moment by three clocks, s: this machine's wall clock, its monotonic clock, ``/clock`` (None: unpublished)."""

    wall_s: float
    monotonic_s: float
    clock_s: float | None = None


@dataclass(frozen=True, eq=False)
class Source(Generic[T]):
    """Topic or service that a check needs; ``fold`` summarizes its messages or responses."""

    interface: Topic | Service
    #: Previous summary (None at first), message and arrival -> new summary.
    fold: Callable[[T | None, Any, CheckTime], T]

    @property
    def name(self) -> str:
        return self.interface.name


def newest(interface: Topic | Service, read: Callable[[Any], T]) -> Source[T]:
    return Source(interface, lambda previous, message, arrival: read(message))


@dataclass(frozen=True)
class Observations:
    """All observations of a robot. Names of nodes and of topics in the graph are absolute."""

    namespace: str  # with a leading slash
    waited_s: float  # longest observation time
    now: CheckTime
    domain: int = 0
    simulated: bool = False  # True if a simulated robot was requested
    map: OccupancyMap | None = None  # map of the game
    map_file: str = ""  # name or file of the map, as given
    environment: Mapping[str, str] = field(default_factory=dict)
    middleware: str = ""
    nodes: tuple[str, ...] = ()  # all other nodes in the domain
    publishers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # by topic: the node of each publisher
    subscribers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    values: dict[Source[Any], Any] = field(default_factory=dict)  # summaries of topics, and responses
    arrivals: dict[Source[Any], tuple[float, ...]] = field(default_factory=dict)  # last two monotonic times, s
    unavailable: dict[str, str] = field(default_factory=dict)  # relative topic: why there is no subscription
    unreadable: dict[str, str] = field(default_factory=dict)  # relative topic: error in its messages

    def full(self, name: str) -> str:
        """Return a name in the robot's namespace; an absolute name stays unchanged."""
        return name if name.startswith("/") else f"{self.namespace.rstrip('/')}/{name}"

    def has(self, name: str) -> bool:
        """Return True if the node ``name`` exists in the robot's namespace."""
        return self.full(name) in self.nodes

    def get(self, source: Source[T]) -> T | None:
        return self.values.get(source)

    def publishers_of(self, topic: str) -> list[str]:
        return list(dict.fromkeys(self.publishers.get(self.full(topic), ())))

    @property
    def own(self) -> list[str]:
        """Nodes in the robot's namespace."""
        return [name for name in self.nodes if name.startswith(self.full(""))]

    @property
    def virtual(self) -> bool:
        """True if a simulated robot exists or was requested."""
        return self.simulated or self.has(SIMULATOR)

    @property
    def real_nav2(self) -> bool:
        """True if a real Nav2 drives: on a real robot or on a simulated base."""
        return not self.virtual or self.full(SIMULATOR) in self.publishers_of("battery_state")

    @property
    def within(self) -> str:
        return f"within {self.waited_s:g} s"

    def silence(self, topic: str) -> str:
        """Explain, as far as the observations allow, why no message of a topic was received."""
        if topic in self.unreadable:
            return f"{topic} cannot be used: {self.unreadable[topic]}"
        return self.unavailable.get(topic, f"{topic} not received {self.within}")

    def not_yet(self, summary: str, remedy: str, command: str = "") -> Finding:
        """Return a BAD finding that more time may change; for a simulated robot, its own remedy replaces ``remedy``."""
        if self.virtual:
            of_nav2 = self.real_nav2 and command.startswith("ros2 launch")
            remedy, command = _NAV2_LOG if of_nav2 else RESTART_GAME, self.start_game
        return bad(summary, remedy, command, settled=False)

    def not_received(self, source: Source[Any]) -> Finding:
        """Return an UNKNOWN finding for a topic of a real base that was not received."""
        if not self.real_nav2:
            return unknown("a simulated robot has none")
        remedy, command = "some bases publish it rarely: listen for longer, --wait 60", ""
        if source.name in self.unavailable:
            remedy = "source /opt/ros/jazzy/setup.bash; without a ROS installation"
            command = "python -m tools.ros_interfaces.build"
        return unknown(self.silence(source.name), remedy, command, settled=False)

    @property
    def other_domain(self) -> int:
        return self.domain + 1 if self.domain < 101 else 1

    def game_command(self, command: str) -> str:
        """Return ``pacman-env ros`` with this command for the robot's game."""
        place = self.namespace.strip("/") or "/"
        return f"pacman-env ros {command} --namespace {place}{' --sim' if self.virtual else ''}"

    @property
    def start_game(self) -> str:
        nav2 = " --nav2" if self.virtual and self.real_nav2 else ""
        return self.game_command(f"up --map {self.map_file or 'FILE_OR_NAME'}") + nav2

    def launch(self, part: str) -> str:
        """Return the command that starts ``localization`` or ``nav2`` on a robot."""
        file = self.map_file or "$PWD/home.yaml"
        path = file if file.lower().endswith(".yaml") else f"$PWD/maps/{file}.yaml"
        namespace = f" namespace:={self.namespace}" if self.namespace != "/" else ""
        given = "params_file:=$PWD/config/nav2.yaml" if part == "nav2" else f"map:={path}"
        return f"ros2 launch turtlebot4_navigation {part}.launch.py{namespace} {given}"


@dataclass(frozen=True, eq=False)
class Check:
    name: str
    question: str
    answer: Callable[[Observations], Finding | None]  # returns None if the question does not apply
    sources: tuple[Source[Any], ...] = ()
    needs_robot: bool = True  # False: also answered without a robot

    def find(self, robot: Observations) -> Finding | None:
        finding = self.answer(robot)
        return finding and replace(finding, check=self.name, question=self.question)


def listed(names: Iterable[str]) -> str:
    items = list(names)
    more = f" and {len(items) - _LISTED} more" if len(items) > _LISTED else ""
    return ", ".join(items[:_LISTED]) + more


def count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
