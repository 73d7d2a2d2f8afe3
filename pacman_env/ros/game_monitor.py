"""State of a game as its topics report it: the rule for valid messages and the newest value of each topic.

The operator's page, the status line, the doctor and bags read a game with it. It subscribes to nothing: its owner
passes each message to :meth:`GameMonitor.update`, and shows the changes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import MAX_SPEED_MPS
from pacman_env.ros import message_conversion as messages
from pacman_env.ros import topics
from pacman_env.ros.message_conversion import LONGEST_WORD, BadMessage, Pose, Position
from pacman_env.ros.selector.reasons import troubles_of
from pacman_env.ros.text import plain

_LONGEST_REPORT = 10_000  # characters
_MOST = 10**9
_MOST_PROCESSES = 100

Configuration = Mapping[str, Any]  # see ``message_conversion.configuration_of``
#: Configurations by the node's name and the start, machine and number of its process.
Processes = dict[tuple[str, tuple[float, str, int]], Configuration]


class Stamped(NamedTuple):
    pose: Pose  # in the map frame
    stamp_ns: int


def stamped_pose_of(message: Any) -> Stamped:
    return Stamped(messages.pose_of(message), messages.nanoseconds_of(message.header.stamp))


def add_process(processes: Processes, configuration: Configuration) -> Processes:
    key = configuration["node"], configuration["started"]
    if key in processes or len(processes) < _MOST_PROCESSES:
        processes[key] = configuration
    return processes


def processes_of(message: Any) -> Mapping[str, Any]:
    """Return ``processes`` (why each does not run, "" if it runs), the newest ``event`` and its ``number``."""
    content = messages.object_of(message, _LONGEST_REPORT)
    try:
        reasons = {plain(str(name), 100): plain(str(text), LONGEST_WORD) for name, text in content["processes"].items()}
        return {"processes": reasons, "event": plain(str(content["event"]), 300), "number": int(content["number"])}
    except (ValueError, TypeError, LookupError, AttributeError):
        raise BadMessage("not the processes of a game") from None


class Monitored(NamedTuple):
    """Topic of one value of the game; ``read`` extracts the value from a message and raises BadMessage."""

    topic: topics.Topic
    read: Callable[[Any], Any]


def _count(topic: topics.Topic, least: int = 0) -> Monitored:
    return Monitored(topic, lambda message: int(messages.number_of(message, least, _MOST)))


#: Monitored topics by the name of the monitor's field.
MONITORED = {
    "state": Monitored(topics.GAME_STATE, lambda message: messages.word_of(message, topics.STATE_WORDS)),
    "result": Monitored(topics.GAME_RESULT, lambda message: plain(message.data, LONGEST_WORD)),
    "round": _count(topics.ROUND, 1),
    "score": _count(topics.SCORE),
    "pellets_collected": _count(topics.PELLETS_COLLECTED),
    "pellets_spawned": _count(topics.PELLETS_SPAWNED),
    "ghosts_caught": _count(topics.GHOSTS_CAUGHT),
    "harmless_until_s": Monitored(
        topics.HARMLESS_GHOSTS, lambda message: messages.ghost_times_of(message, len(message.data) // 2)
    ),
    "clyde_speed_mps": Monitored(topics.CLYDE_SPEED, lambda message: messages.number_of(message, 0.0, MAX_SPEED_MPS)),
    "condition": Monitored(topics.DIAGNOSTICS, messages.object_of),
    "started": Monitored(topics.PROCESSES, processes_of),
    "configuration": Monitored(topics.CONFIGURATION, messages.configuration_of),
    "pellets": Monitored(topics.PELLET_MARKERS, messages.pellets_of),
    "pose": Monitored(topics.AMCL_POSE, stamped_pose_of),
}
_NAMES = {value.topic.name: name for name, value in MONITORED.items()}
TOPICS = (*(value.topic for value in MONITORED.values()), *topics.GHOST_POSES)
_GHOSTS = {topic.name: number for number, topic in enumerate(topics.GHOST_POSES)}


@dataclass
class GameMonitor:
    """Newest valid value of each topic; None or empty before the first message."""

    state: str | None = None
    result: str | None = None  # result of the last round, empty before the first
    round: int | None = None
    score: int | None = None
    pellets_collected: int | None = None
    pellets_spawned: int | None = None
    ghosts_caught: int | None = None  # in this round; None in a game without power pellets
    #: (G, 2) ROS times, s: until when each ghost is harmless, and until when it is away.
    harmless_until_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    clyde_speed_mps: float | None = None
    condition: Mapping[str, Any] = field(default_factory=dict)  # the goal selector's diagnostics
    started: Mapping[str, Any] = field(default_factory=dict)  # processes and events of ``ros up``
    configuration: Configuration = field(default_factory=dict)  # the last one received, of any node
    pellets: Mapping[int, Position] = field(default_factory=dict)
    power_pellets: set[int] = field(default_factory=set)  # ids, collected pellets included
    pose: Stamped | None = None  # the last ``amcl_pose``
    ghosts: dict[int, Stamped] = field(default_factory=dict)
    began_s: float = 0.0  # time of the first message of the current state
    processes: Processes = field(default_factory=dict)  # of all nodes; a restarted node has several processes
    invalid: dict[str, str] = field(default_factory=dict)  # by name of a value: why its last message was refused

    @property
    def troubles(self) -> dict[str, str]:
        """Texts of the current troubles by kind, as the game reports them."""
        return troubles_of(self.condition)

    @property
    def nodes(self) -> dict[str, Configuration]:
        """Last published configuration by the node's name."""
        return {name: configuration for (name, _), configuration in self.processes.items()}

    def valid(self, name: str) -> Any:
        """Return a value; None if its last message was invalid."""
        return None if name in self.invalid else getattr(self, name)

    def update(self, topic: str, message: Any, now_s: float = 0.0) -> None:
        """Update the value of ``topic`` from a message that was received at ``now_s``; ignore unmonitored topics.

        Raises BadMessage if the message is invalid; then no value changes.
        """
        if topic in _GHOSTS:
            self.ghosts[_GHOSTS[topic]] = stamped_pose_of(message)
        if topic not in _NAMES:
            return
        name, earlier = _NAMES[topic], self.state
        try:
            setattr(self, name, MONITORED[name].read(message))
        except BadMessage as error:
            self.invalid[name] = plain(str(error), LONGEST_WORD)
            raise
        self.invalid.pop(name, None)
        if name == "state" and self.state != earlier:
            self.began_s = now_s
        elif name == "configuration":
            add_process(self.processes, self.configuration)
        elif name == "pellets":
            power = messages.power_pellets_of(message)
            self.power_pellets = power | (self.power_pellets - self.pellets.keys())
