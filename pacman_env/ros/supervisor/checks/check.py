"""What a check is: a question about a robot, answered from what was observed of it. Imports nothing of ROS.

A new check is a function in one of this folder's files, and an entry in ``CHECKS`` at that file's end."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, NamedTuple, TypeVar

from pacman_env.world.maps.occupancy import OccupancyMap

from ..game_nodes import SIMULATOR

OK, BAD, UNKNOWN = "ok", "BAD", "-"
LONGEST_JSON = 100_000  # characters
FIREWALL = "sudo ufw allow proto udp from 192.168.0.0/16"  # these two are commands
RESTART = "sudo systemctl restart turtlebot4"
RESTART_GAME = "start or restart the simulated game"
START_AGAIN = "ros up starts it again, at most 3 times in 10 min; under ros2 launch end its process"
_LISTED = 5  # names in one summary
_NAV2_LOG = (
    "Nav2 is not up yet, or has ended: read nav2.log in the folder that ros up prints; with --nav2 none, start it with "
    "the command that is printed there"
)

T = TypeVar("T")


@dataclass(frozen=True)
class Finding:
    check: str  # name; with the question, set by Check.find
    question: str
    status: str  # OK, BAD or UNKNOWN: the question cannot be answered, or does not apply
    summary: str  # what was observed, with figures and units
    remedy: str = ""
    command: str = ""  # the one command of the remedy, if it is a command
    settled: bool = True  # False while more time may change it

    @classmethod
    def ok(cls, summary: str) -> Finding:
        return cls("", "", OK, summary)

    @classmethod
    def bad(cls, summary: str, remedy: str, command: str = "", settled: bool = True) -> Finding:
        return cls("", "", BAD, summary, remedy, command, settled)

    @classmethod
    def unknown(cls, summary: str, remedy: str = "", command: str = "", settled: bool = True) -> Finding:
        return cls("", "", UNKNOWN, summary, remedy, command, settled)


class Moment(NamedTuple):
    """A time, s, by this machine's clock, by its monotonic clock and by ``/clock`` (None if it is not published)."""

    wall_s: float
    monotonic_s: float
    clock_s: float | None = None


@dataclass(frozen=True, eq=False)
class Source(Generic[T]):
    """A topic that a check needs, and what is kept of its messages."""

    name: str  # relative to the robot's namespace
    type_name: str  # package/Type
    fold: Callable[[T | None, Any, Moment], T]  # what is kept after a message, from before (None at first) and arrival
    qos: str = "EVENTS"  # name of a profile in topics.py


@dataclass(frozen=True, eq=False)
class Request(Generic[T]):
    """A service that a check needs, and what is kept of its response."""

    name: str
    type_name: str
    read: Callable[[Any], T]


def newest(read: Callable[[Any], T]) -> Callable[[T | None, Any, Moment], T]:
    return lambda before, message, arrival: read(message)


@dataclass(frozen=True)
class Observations:
    """All that was observed of a robot. Names of nodes are full, as are those of the graph's topics."""

    namespace: str  # with its slash
    waited_s: float  # at most
    now: Moment
    domain: int = 0
    simulated: bool = False  # a simulated robot was asked for
    map: OccupancyMap | None = None  # the game's
    map_file: str = ""  # how it was named
    environment: Mapping[str, str] = field(default_factory=dict)
    middleware: str = ""
    nodes: tuple[str, ...] = ()  # all others in the domain
    publishers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # by topic: a node for each publisher
    subscribers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    values: dict[Source[Any] | Request[Any], Any] = field(default_factory=dict)  # what is kept
    unavailable: dict[str, str] = field(default_factory=dict)  # by relative topic, why there is no subscription
    unreadable: dict[str, str] = field(default_factory=dict)  # by relative topic, what was wrong with messages

    def full(self, name: str) -> str:
        """A name in the robot's namespace; an absolute one stays as it is."""
        return name if name.startswith("/") else f"{self.namespace.rstrip('/')}/{name}"

    def get(self, source: Source[T] | Request[T]) -> T | None:
        return self.values.get(source)

    def publishers_of(self, topic: str) -> list[str]:
        return list(dict.fromkeys(self.publishers.get(self.full(topic), ())))

    def subscribers_of(self, topic: str) -> list[str]:
        return list(dict.fromkeys(self.subscribers.get(self.full(topic), ())))

    @property
    def own(self) -> list[str]:
        """The nodes in the robot's namespace."""
        return [name for name in self.nodes if name.startswith(self.full(""))]

    @property
    def in_simulation(self) -> bool:
        return self.full(SIMULATOR) in self.nodes

    @property
    def virtual(self) -> bool:
        """Whether a simulated robot is there, or should be."""
        return self.simulated or self.in_simulation

    @property
    def real_nav2(self) -> bool:
        """Whether a Nav2 is to drive: that of a real robot, or a real one on a simulated base."""
        return not self.virtual or self.full(SIMULATOR) in self.publishers_of("battery_state")

    @property
    def within(self) -> str:
        return f"within {self.waited_s:g} s"

    def silence(self, topic: str) -> str:
        """Why nothing of a topic was received, as far as is known."""
        if topic in self.unavailable:
            return self.unavailable[topic]
        if topic in self.unreadable:
            return f"{topic} cannot be used: {self.unreadable[topic]}"
        return f"{topic} not received {self.within}"

    def waiting_remedy(self, topic: str) -> tuple[str, str]:
        """Remedy and command where a topic that may be published rarely was not received."""
        if topic in self.unavailable:
            build = "python -m tools.ros_interfaces.build"
            return "source /opt/ros/jazzy/setup.bash; without a ROS installation", build
        return "some bases publish it rarely: listen for longer, --wait 60", ""

    def not_yet(self, summary: str, remedy: str, command: str = "") -> Finding:
        """BAD for now; where the robot is simulated, with a remedy for that."""
        if self.virtual:
            of_nav2 = self.real_nav2 and command in (self.start_nav2, self.start_localization)
            remedy, command = _NAV2_LOG if of_nav2 else RESTART_GAME, self.start_game
        return Finding.bad(summary, remedy, command, settled=False)

    def not_received(self, source: Source[Any]) -> Finding:
        """UNKNOWN: a topic of a real base was not received."""
        if not self.real_nav2:
            return Finding.unknown("a simulated robot has none")
        return Finding.unknown(self.silence(source.name), *self.waiting_remedy(source.name), settled=False)

    @property
    def other_domain(self) -> int:
        return self.domain + 1 if self.domain < 101 else 1

    @property
    def start_game(self) -> str:
        """The command; so are the next two."""
        sim = (" --sim --nav2" if self.real_nav2 else " --sim") if self.virtual else ""
        where = self.namespace.strip("/") or "/"
        return f"pacman-env ros up --map {self.map_file or 'FILE_OR_NAME'} --namespace {where}{sim}"

    @property
    def start_localization(self) -> str:
        file = self.map_file or "$PWD/home.yaml"
        return self._launch("localization", f"map:={file if file.endswith('.yaml') else f'$PWD/maps/{file}.yaml'}")

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
    answer: Callable[[Observations], Finding | None]  # None if the question does not arise
    sources: tuple[Source[Any] | Request[Any], ...] = ()
    needs_robot: bool = True  # False: it is asked without a robot, too

    def find(self, robot: Observations) -> Finding | None:
        finding = self.answer(robot)
        return finding and replace(finding, check=self.name, question=self.question)


def listed(names: Iterable[str]) -> str:
    found = list(names)
    more = f" and {len(found) - _LISTED} more" if len(found) > _LISTED else ""
    return ", ".join(found[:_LISTED]) + more


def both(names: Sequence[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def seconds(stamp: Any) -> float:
    return float(stamp.sec) + float(stamp.nanosec) / 1e9
