"""Base of all checks: a check answers a question about a robot from observations. Does not import ROS.

A new check is a function in one of this folder's files, and an entry in ``CHECKS`` at the end of that file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, NamedTuple, TypeVar

from pacman_env.world.maps.occupancy import OccupancyMap

from ...game_nodes import SIMULATOR

OK, BAD, UNKNOWN = "ok", "BAD", "-"
FIREWALL = "sudo ufw allow proto udp from 192.168.0.0/16"  # FIREWALL and RESTART are commands of remedies
RESTART = "sudo systemctl restart turtlebot4"
RESTART_GAME = "start or restart the simulated game"
START_AGAIN = "ros up starts it again, at most 3 times in 10 min; under ros2 launch end its process"
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

    @classmethod
    def ok(cls, summary: str) -> Finding:
        return cls("", "", OK, summary)

    @classmethod
    def bad(cls, summary: str, remedy: str, command: str = "", settled: bool = True) -> Finding:
        return cls("", "", BAD, summary, remedy, command, settled)

    @classmethod
    def unknown(cls, summary: str, remedy: str = "", command: str = "", settled: bool = True) -> Finding:
        return cls("", "", UNKNOWN, summary, remedy, command, settled)


class CheckTime(NamedTuple):
    """A moment by three clocks, s: this machine's wall clock, its monotonic clock, ``/clock`` (None: unpublished)."""

    wall_s: float
    monotonic_s: float
    clock_s: float | None = None


@dataclass(frozen=True, eq=False)
class Source(Generic[T]):
    """Topic that a check needs; ``fold`` summarizes its messages."""

    name: str  # relative to the robot's namespace
    type_name: str  # ``package/Type``
    fold: Callable[
        [T | None, Any, CheckTime], T
    ]  # previous summary (None at first), message and arrival -> new summary
    qos: str = "EVENTS"  # name of a profile in topics.py


@dataclass(frozen=True, eq=False)
class Request(Generic[T]):
    """Service that a check needs; ``read`` extracts a value from its response."""

    name: str
    type_name: str
    read: Callable[[Any], T]


def newest(read: Callable[[Any], T]) -> Callable[[T | None, Any, CheckTime], T]:
    return lambda previous, message, arrival: read(message)


def monitored(value: str, name: str, type_name: str) -> Source[Any]:
    """Return the source of the game monitor's value ``value``.

    The value's reader needs ROS and is therefore imported at the first message.
    """

    def read(message: Any) -> Any:
        from ...game_monitor import MONITORED

        return MONITORED[value].read(message)

    return Source(name, type_name, newest(read), "LATCHED")


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
    values: dict[Source[Any] | Request[Any], Any] = field(default_factory=dict)  # summaries of topics, and responses
    unavailable: dict[str, str] = field(default_factory=dict)  # relative topic: why there is no subscription
    unreadable: dict[str, str] = field(default_factory=dict)  # relative topic: error in its messages

    def full(self, name: str) -> str:
        """Return a name in the robot's namespace; an absolute name stays unchanged."""
        return name if name.startswith("/") else f"{self.namespace.rstrip('/')}/{name}"

    def get(self, source: Source[T] | Request[T]) -> T | None:
        return self.values.get(source)

    def publishers_of(self, topic: str) -> list[str]:
        return list(dict.fromkeys(self.publishers.get(self.full(topic), ())))

    def subscribers_of(self, topic: str) -> list[str]:
        return list(dict.fromkeys(self.subscribers.get(self.full(topic), ())))

    @property
    def own(self) -> list[str]:
        """Nodes in the robot's namespace."""
        return [name for name in self.nodes if name.startswith(self.full(""))]

    @property
    def in_simulation(self) -> bool:
        return self.full(SIMULATOR) in self.nodes

    @property
    def virtual(self) -> bool:
        """True if a simulated robot exists or was requested."""
        return self.simulated or self.in_simulation

    @property
    def real_nav2(self) -> bool:
        """True if a real Nav2 drives: on a real robot or on a simulated base."""
        return not self.virtual or self.full(SIMULATOR) in self.publishers_of("battery_state")

    @property
    def within(self) -> str:
        return f"within {self.waited_s:g} s"

    def silence(self, topic: str) -> str:
        """Explain, as far as the observations allow, why no message of a topic was received."""
        if topic in self.unavailable:
            return self.unavailable[topic]
        if topic in self.unreadable:
            return f"{topic} cannot be used: {self.unreadable[topic]}"
        return f"{topic} not received {self.within}"

    def waiting_remedy(self, topic: str) -> tuple[str, str]:
        """Return remedy and command for a topic that was not received, but may only have few messages."""
        if topic in self.unavailable:
            build = "python -m tools.ros_interfaces.build"
            return "source /opt/ros/jazzy/setup.bash; without a ROS installation", build
        return "some bases publish it rarely: listen for longer, --wait 60", ""

    def not_yet(self, summary: str, remedy: str, command: str = "") -> Finding:
        """Return a BAD finding that more time may change; for a simulated robot, its own remedy replaces ``remedy``."""
        if self.virtual:
            of_nav2 = self.real_nav2 and command in (self.start_nav2, self.start_localization)
            remedy, command = _NAV2_LOG if of_nav2 else RESTART_GAME, self.start_game
        return Finding.bad(summary, remedy, command, settled=False)

    def not_received(self, source: Source[Any]) -> Finding:
        """Return an UNKNOWN finding for a topic of a real base that was not received."""
        if not self.real_nav2:
            return Finding.unknown("a simulated robot has none")
        return Finding.unknown(self.silence(source.name), *self.waiting_remedy(source.name), settled=False)

    @property
    def other_domain(self) -> int:
        return self.domain + 1 if self.domain < 101 else 1

    @property
    def start_game(self) -> str:
        """Command that starts the game."""
        sim = (" --sim --nav2" if self.real_nav2 else " --sim") if self.virtual else ""
        place = self.namespace.strip("/") or "/"
        return f"pacman-env ros up --map {self.map_file or 'FILE_OR_NAME'} --namespace {place}{sim}"

    @property
    def start_localization(self) -> str:
        file = self.map_file or "$PWD/home.yaml"
        path = file if file.lower().endswith(".yaml") else f"$PWD/maps/{file}.yaml"
        return self._launch("localization", f"map:={path}")

    @property
    def start_nav2(self) -> str:
        return self._launch("nav2", "params_file:=$PWD/config/nav2.yaml")

    def _launch(self, file: str, more: str) -> str:
        namespace = f" namespace:={self.namespace}" if self.namespace != "/" else ""
        return f"ros2 launch turtlebot4_navigation {file}.launch.py{namespace} {more}"


@dataclass(frozen=True, eq=False)
class Check:
    name: str
    question: str
    answer: Callable[[Observations], Finding | None]  # returns None if the question does not apply
    sources: tuple[Source[Any] | Request[Any], ...] = ()
    needs_robot: bool = True  # False: also answered without a robot

    def find(self, robot: Observations) -> Finding | None:
        finding = self.answer(robot)
        return finding and replace(finding, check=self.name, question=self.question)


def listed(names: Iterable[str]) -> str:
    items = list(names)
    more = f" and {len(items) - _LISTED} more" if len(items) > _LISTED else ""
    return ", ".join(items[:_LISTED]) + more


def both(names: Sequence[str]) -> str:
    """Join names as ``a``, ``a and b``, or ``a, b and c``."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def seconds(stamp: Any) -> float:
    return float(stamp.sec) + float(stamp.nanosec) / 1e9
