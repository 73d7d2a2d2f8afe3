"""``pacman-env ros doctor``: a node that observes what the checks need, and prints faults with their remedies.

It publishes nothing and only calls services that answer questions, so the robot does not move."""

import dataclasses
import json
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, TextIO

import rclpy
from rclpy.executors import SingleThreadedExecutor

from pacman_env import __version__
from pacman_env.ros import topics
from pacman_env.ros.discovery import NAMELESS, full_name, join, users_environment
from pacman_env.ros.game_nodes import full_namespace
from pacman_env.ros.observer import ObserverNode
from pacman_env.ros.process import StopSignals
from pacman_env.ros.supervisor.checks import CHECKS, examine, is_ready, render
from pacman_env.ros.supervisor.checks.check import CheckTime, Observations, Source
from pacman_env.ros.supervisor.checks.domain import CLOCK
from pacman_env.world.maps.occupancy import OccupancyMap, load_map

WAIT_S = 10.0
LONGEST_S = 600.0
NOT_READY = 1  # exit status

_LEAST_S = 2.0  # shortest time, for measuring rates
_PERIOD_S = 0.5  # between two examinations of the observations
_WAITING_S = 0.5  # longest time for handling messages that have arrived
_NAMES_S = 1.0  # node names are discovered after their endpoints
#: Prefixes of this package's observers and of ROS's command line.
_ONLOOKERS = ("pacman_up", "pacman_doctor", "pacman_page", "pacman_recorder", "_ros2cli")
_OF_ALL = ("/rosout", "/parameter_events")  # topics that every node publishes


class Doctor(ObserverNode):
    """Node that observes for at most ``wait_s`` in :meth:`observe`; ``map`` is the game's map, from ``map_file``."""

    #: rclpy 7.1.5's EventsExecutor fails for callbacks that take a message's times of sending and reception.
    make_executor = staticmethod(lambda context: SingleThreadedExecutor(context=context))

    def __init__(
        self, namespace: str, domain: int, map: OccupancyMap | None, map_file: str, sim: bool, wait_s: float
    ) -> None:
        super().__init__("pacman_doctor", namespace, domain)
        now, middleware = CheckTime(time.time(), time.monotonic()), rclpy.get_rmw_implementation_identifier()
        self._observed = Observations(
            *(namespace, wait_s, now, domain, sim, map, map_file, users_environment(), middleware)
        )
        self._values = self._observed.values
        self._received = 0  # number of messages
        self._callers: dict[Source[Any], Any] = {}
        for source in dict.fromkeys(source for check in CHECKS for source in check.sources):
            try:
                if isinstance(source.interface, topics.Service):
                    self._callers[source] = source.interface.client(self)
                else:
                    source.interface.subscription(self, partial(self._receive, source))
            except (ImportError, AttributeError):
                missing = f"the message type {source.interface.type_name} is not installed here"
                self._observed.unavailable[source.name] = missing

    def observe(self, enough: Callable[[], bool]) -> None:
        """Receive messages for ``wait_s``, or until all findings are settled or ``enough`` returns True."""
        start_s = time.monotonic()
        end, due = start_s + self._observed.waited_s, start_s + _LEAST_S
        while (now := time.monotonic()) < end and not enough():
            self.spin(min(0.1, end - now))
            if now >= due:
                due = now + _PERIOD_S
                for source, client in self._callers.items():
                    self._call(source, client)
                if all(finding.settled for finding in examine(self.observations())):
                    break
        self.spin_until(lambda: not self._nameless() or enough(), _NAMES_S)

    def observations(self) -> Observations:
        end, count = time.monotonic() + _WAITING_S, -1
        while count != self._received and time.monotonic() < end:
            count = self._received
            self.spin(0.0)
        names = [pair for pair in self.get_node_names_and_namespaces() if not pair[0].startswith(_ONLOOKERS)]
        nodes = tuple(sorted({full_name(*pair) for pair in names}))
        publishers, subscribers = self._graph()
        now = self._moment(time.time())
        return dataclasses.replace(self._observed, now=now, nodes=nodes, publishers=publishers, subscribers=subscribers)

    def _moment(self, wall_s: float) -> CheckTime:
        """Return the present or past moment ``wall_s`` (s, this machine's wall clock) by all clocks."""
        clock, age_s = self._values.get(CLOCK), max(0.0, time.time() - wall_s)
        return CheckTime(wall_s, time.monotonic() - age_s, None if clock is None else clock.clock_s)

    def _receive(self, source: Source[Any], message: Any, info: Mapping[str, int]) -> None:
        # Time of reception by the middleware: on a busy machine a message may wait here for seconds.
        self._received += 1
        arrival = self._moment((info["received_timestamp"] or time.time_ns()) / 1e9)
        self._observed.arrivals[source] = (*self._observed.arrivals.get(source, ())[-1:], arrival.monotonic_s)
        try:
            self._values[source] = source.fold(self._values.get(source), message, arrival)
        except Exception as error:  # a bad message of a foreign node must not end the doctor
            self._observed.unreadable[source.name] = f"{type(error).__name__}: {error}"

    def _call(self, source: Source[Any], client: Any) -> None:
        """Call a service again unless it has answered: the answer to an early call may be lost."""

        def store(future: Any) -> None:
            if future.exception() is None:
                self._values[source] = source.fold(None, future.result(), self._moment(time.time()))

        if source not in self._values and client.service_is_ready():
            client.call_async(client.srv_type.Request()).add_done_callback(store)

    def _graph(self) -> tuple[dict[str, tuple[str, ...]], dict[str, tuple[str, ...]]]:
        """Return the publishing and the subscribing nodes by topic, without this node."""
        names = [name for name, _ in self.get_topic_names_and_types() if name not in _OF_ALL]
        own = self.get_fully_qualified_name()

        def others(infos: Iterable[Any]) -> tuple[str, ...]:
            nodes = [full_name(info.node_name, info.node_namespace) for info in infos]
            return tuple(sorted(node for node in nodes if node != own))

        publishers = {name: others(self.get_publishers_info_by_topic(name)) for name in names}
        return publishers, {name: others(self.get_subscriptions_info_by_topic(name)) for name in names}

    def _nameless(self) -> bool:
        return any(NAMELESS in nodes for ends in self._graph() for nodes in ends.values())


def doctor(
    namespace: str,
    domain: int | None = None,
    map: str | None = None,
    sim: bool = False,
    wait_s: float = WAIT_S,
    as_json: bool = False,
    out: TextIO | None = None,
) -> int:
    """Print the findings; call in the main thread. Returns 1 if a finding is BAD or after SIGINT or SIGTERM, else 0."""
    place = full_namespace(namespace)
    if not 0.0 < wait_s <= LONGEST_S:  # also refuses NaN
        raise ValueError(f"wait {wait_s:g} s: must be more than 0 and at most {LONGEST_S:g}")
    game_map = None if map is None else load_map(map)
    number = join(domain, this_machine=sim)
    with StopSignals() as stop, Doctor(place, number, game_map, map or "", sim, wait_s) as node:
        node.observe(lambda: stop.asked)
        findings = examine(node.observations())
    if stop.asked:
        print("doctor: stopped before the end", file=sys.stderr)
        return NOT_READY
    ready = is_ready(findings)
    if as_json:
        report = {
            "version": __version__,
            "namespace": place,
            "domain": number,
            "map": None if game_map is None else {"name": game_map.name, "hash": game_map.hash},
            "ready": ready,
            "findings": [dataclasses.asdict(finding) for finding in findings],
        }
        text = json.dumps(report, indent=2)
    else:
        on_map = "" if game_map is None else f", map {game_map.name} {game_map.hash[:12]}"
        text = render(findings, f"pacman-env {__version__}: {place} in domain {number}{on_map}")
    print(text, file=out or sys.stdout)
    return 0 if ready else NOT_READY
