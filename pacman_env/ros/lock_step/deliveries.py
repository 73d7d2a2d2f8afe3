"""Messages between the nodes of a lock-step game: each is taken when sent, and waits in one queue."""

import contextlib
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from rclpy.action import ActionServer
from rclpy.client import Client
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from rclpy.service import Service
from rclpy.subscription import Subscription

from ..rclpy_private import expire_goals, has_goals
from ..topics import CLOCK
from . import entities
from .entities import ACTION, Index
from .members import Delivery, Member
from .watchdog import Watchdog

MOST_DELIVERIES = 100_000  # most deliveries in one step
_JOIN_S = 30.0  # real time for latched messages to reach a new node
_Span = tuple[int, int]  # start and end of a publication, ns of the machine's clock
_ANY: _Span = (0, 2**63)
_Ended = Callable[[Member], None]


class NodeFailed(RuntimeError):
    """Raised if a node's callback raises an exception, or if nodes answer each other endlessly."""


class Deliveries:
    """Queue of the messages between members.

    ``ended`` is called with a member whose node has set its exit status during a callback. A callback may take
    ``silence_s`` of real time.
    """

    def __init__(self, members: list[Member], silence_s: float, ended: _Ended) -> None:
        self._members, self._ended = members, ended
        self.witnesses: list[Callable[[Delivery], None]] = []  # called with each delivery before its handling
        self._changed = True  # True if entities have changed since the index was built
        self.watchdog = Watchdog(silence_s)
        self.queue: deque[Delivery] = deque()
        self._turn: Member | None = None  # member whose code runs
        self._latched: dict[Any, deque[_Span]] = {}  # by publisher: publications for later subscriptions
        self._with_statuses: set[ActionServer] = set()  # servers whose statuses rclpy publishes in C
        self._index = Index([])

    @property
    def index(self) -> Index:
        if self._changed:
            self._changed = False
            self._index = Index(self._members)
            self._with_statuses &= {waitable for _, waitable in self._index.waitables}
        return self._index

    def entities_changed(self) -> None:
        self._changed = True

    @contextlib.contextmanager
    def making(self, name: str) -> Iterator[None]:
        previous, self._turn = self._turn, None
        try:
            with self.watchdog.during(name):
                yield
        finally:
            self._turn = previous

    # Messages that members send

    def watch(self, entity: Any) -> None:
        """Make receivers take the messages of a publisher, client or service as soon as they are sent."""
        if isinstance(entity, Publisher):
            entity.publish = partial(self._publish, entity, entity.publish)
        elif isinstance(entity, Client):
            entity.call_async = partial(self._request, entity, entity.call_async)
        elif isinstance(entity, Service) and "send_response" not in vars(entity):
            entity.send_response = partial(self._respond, entity, entity.send_response)

    def _publish(self, publisher: Publisher, publish: Callable[[Any], None], message: Any) -> None:
        begin_ns = time.time_ns()
        publish(message)
        if publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            if publisher not in self._latched:
                self._latched[publisher] = deque(maxlen=publisher.qos_profile.depth)
            self._latched[publisher].append((begin_ns, time.time_ns()))
        if self._turn is not None:
            for member, sub in self.index.by_topic[self.index.name_of(publisher)]:
                if (item := entities.message(sub)) is not None:
                    self._put_taken(member, sub, item)

    def _request(self, client: Client, call: Callable[[Any], Any], request: Any) -> Any:
        name = self.index.name_of(client)
        answer = call(request)
        for member, service in self.index.services[name]:
            self._take(member, service)
        if ACTION in name:
            self._take_actions()
        return answer

    def _respond(self, service: Service, send: Callable[[Any, Any], None], response: Any, header: Any) -> None:
        send(response, header)
        for member, client in self.index.clients[self.index.name_of(service)]:
            self._take(member, client)

    def _take(self, member: Member, entity: Subscription | Service | Client) -> None:
        for item in entities.messages(entity):
            self._put_taken(member, entity, item)

    def _take_actions(self) -> None:
        """Take pending action messages, which rclpy sends in C, so that calls cannot be intercepted."""
        index = self.index
        for member, client in index.clients_of_actions:
            self._take(member, client)
        for member, sub in index.topics_of_actions:
            while (item := entities.message_if_any(sub)) is not None:
                self._put_taken(member, sub, item)
        for member, waitable in index.waitables:
            if isinstance(waitable, ActionServer) and has_goals(waitable):
                self._with_statuses.add(waitable)
            while data := entities.data_of_action(waitable):
                self._put_taken(member, waitable, data)

    def take_all(self) -> None:
        """Take all pending messages from the middleware, including messages from other processes."""
        self._turn = None
        for member, entity in self.index.all:
            self._take(member, entity)
        self._take_actions()

    def expire_goals(self) -> None:
        """Make action servers remove goals that ended at least 15 minutes ago."""
        for member, server in self.index.waitables:
            if isinstance(server, ActionServer) and (expired := expire_goals(server)):
                self._put_taken(member, server, {"expired": expired})

    def _put_taken(self, member: Member, entity: Any, item: Any) -> None:
        self.put(self.index.delivery(member, entity, item, self._turn))

    def put(self, delivery: Delivery) -> None:
        self.queue.append(delivery)

    # New subscriptions

    def join(self, member: Member, known: set[Subscription]) -> None:
        """Take the messages for a new member: messages published while it was created, and latched messages.

        Subscriptions in ``known`` have their latched messages already. Messages are handled in the order of
        publication.
        """
        items: list[tuple[int, Member, Subscription, Any]] = []
        times_ns: defaultdict[Subscription, list[int]] = defaultdict(list)  # times of publication, ns
        latched_of = {sub: self._latched_for(member, sub) for sub in member.node.subscriptions if sub not in known}
        end = time.monotonic() + _JOIN_S
        while True:
            for other, sub in self.index.subscriptions:
                for message in entities.messages(sub):
                    at_ns = message[1]["source_timestamp"]
                    items.append((at_ns, other, sub, message))
                    times_ns[sub].append(at_ns)
            missing = [sub for sub, latched in latched_of.items() if not _complete(latched, times_ns[sub])]
            if not missing:
                break
            if time.monotonic() > end:
                names = ", ".join(sub.topic_name for sub in missing)
                raise NodeFailed(f"{member.name}: latched messages of {names} have not arrived within {_JOIN_S:g} s")
            time.sleep(0.001)
        newest = {sub: sorted(times_ns[sub])[-sub.qos_profile.depth :] for sub in latched_of}
        for at_ns, other, sub, message in sorted(items, key=lambda one: one[0]):
            if sub not in latched_of or at_ns in newest[sub]:
                self._put_taken(other, sub, message)
        self.drain()

    def _latched_for(self, member: Member, sub: Subscription) -> list[deque[_Span]]:
        """Return for each publisher of other members the publications that a new subscription receives."""
        if sub.qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL:
            return []
        name = sub.topic_name
        publishers = (p for other in self._members if other is not member for p in other.node.publishers)
        statuses = [deque([_ANY]) for server in self._with_statuses if server.statuses_name == name]
        return statuses + [self._latched[one] for one in publishers if one in self._latched and one.topic_name == name]

    def discard(self, member: Member) -> None:
        self.queue = deque(one for one in self.queue if one.member is not member)
        for publisher in member.node.publishers:
            self._latched.pop(publisher, None)

    # Handling

    def drain(self) -> None:
        """Handle all waiting messages and the messages that follow; raises NodeFailed."""
        for _ in range(MOST_DELIVERIES):
            if not self.queue:
                return
            delivery = self.queue.popleft()
            member = delivery.member
            if not member.present:
                continue
            if self.index.destroyed(delivery.entity):
                continue
            for witness in self.witnesses:
                witness(delivery)
            if delivery.name == CLOCK.name and entities.sets_time(delivery.entity):  # setting a clock sends no messages
                delivery.handle()
            else:
                self.run(member, delivery.handle)
        names = sorted({f"{one.member.name} ({one.name})" for one in self.queue})
        raise NodeFailed(f"no end to messages in one step, {MOST_DELIVERIES} so far; waiting: {', '.join(names)}")

    def run(self, member: Member, handle: Callable[[], Any]) -> Any:
        """Call a member's callback, run its tasks and return the callback's result; NodeFailed for their exceptions."""
        previous, self._turn = self._turn, member
        try:
            with self.watchdog.during(member.name):
                result = handle()
                member.executor.run_tasks()
            if member in self.index.with_actions:
                self._take_actions()
        except Exception as error:
            raise NodeFailed(f"{member.name}: {type(error).__name__}: {error}") from error
        finally:
            self._turn = previous
        if member.node.status is not None and not member.ending:
            self._ended(member)
        return result


def _complete(latched: list[deque[_Span]], times_ns: list[int]) -> bool:
    """Return True if all publications in ``latched`` have arrived, judged by the publication times ``times_ns``."""
    spans = (span for one in latched for span in one)
    return all(any(begin_ns <= at_ns <= end_ns for at_ns in times_ns) for begin_ns, end_ns in spans)
