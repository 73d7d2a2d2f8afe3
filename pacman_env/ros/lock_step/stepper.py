"""Steps the nodes of one process: each message is handled before the next one, and all of them before time goes on."""

from __future__ import annotations

import contextlib
import time
from collections import defaultdict, deque
from collections.abc import Callable
from functools import partial
from typing import Any

import rclpy
from rclpy.action import ActionClient, ActionServer
from rclpy.client import Client
from rclpy.context import Context
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from rclpy.service import Service
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

from ..discovery import undiscovered
from ..node import LAST_MESSAGES_S, BaseNode
from ..supervisor.game_nodes import QUIET
from ..surroundings import within
from ..topics import CLOCK
from . import entities
from .entities import ACTION, Index
from .losses import Losses
from .members import Delivery, Member, NodeExecutor
from .surroundings import LockStepSurroundings, SimulatedWall
from .watchdog import Watchdog

STEP_NS = 50_000_000  # of physics: Nav2's controller rate
SILENCE_S = 60.0  # of real time that one callback may take
MOST_DELIVERIES = 100_000  # in one step
_JOIN_S = 30.0  # of real time, for what is latched to reach a node that has just been made
Witness = Callable[[Delivery], None]
_Span = tuple[int, int]  # begin and end of a publication, ns of the machine's clock
_ANY: _Span = (0, 2**63)


class NodeFailed(RuntimeError):
    """A callback of a node has raised an exception, or nodes answer one another without end."""


class LockStep:
    """Nodes of this process, and the simulated time that they share.

    Args:
        seed: of what nodes draw, and of losses.
        domain: ROS domain; None: that of the environment.
        silence_s: after so much real time in one callback, its node is named and the process ends.
        alone: the nodes meet those of no other process, whatever their domain; else they can be told from those.
    """

    def __init__(
        self, seed: int = 0, domain: int | None = None, silence_s: float = SILENCE_S, alone: bool = True
    ) -> None:
        self.context = Context()
        arguments, signals = ["--ros-args", *QUIET], SignalHandlerOptions.NO
        with undiscovered() if alone else contextlib.nullcontext():
            rclpy.init(args=arguments, context=self.context, domain_id=domain, signal_handler_options=signals)
        self.wall = SimulatedWall(seed)
        self.losses = Losses(seed)
        self.members: list[Member] = []
        self.witnesses: list[Witness] = []  # see each delivery before it is handled
        self._observed: defaultdict[str, list[tuple[Member, Callable[[Any], None]]]] = defaultdict(list)
        self.ended: Callable[[Member], None] = lambda member: None  # called after a node has ended by itself
        self._alone = alone
        self.step_ns = STEP_NS  # of the simulated robot, once there is one
        self._started = 0
        self._queue: deque[Delivery] = deque()
        self._turn: Member | None = None  # whose code runs
        self._latched: dict[Any, deque[_Span]] = {}  # by publisher: of what the middleware keeps for those that come
        self._with_statuses: set[ActionServer] = set()  # rclpy publishes these in C
        self._index = Index()
        self._changed = True
        self._closed = False
        self._watchdog = Watchdog(silence_s)

    # Members

    def add(self, make: Callable[[], BaseNode], arguments: list[str], loses: bool = True) -> Member:
        """Make a node; what is latched reaches it before this returns.

        Args:
            make: called without arguments.
            arguments: of ROS, ``--ros-args ...``.
            loses: losses concern it, too.

        Raises:
            Exception: what the making raises.
            NodeFailed: a latched message does not arrive.
        """
        self._started += 1
        surroundings = LockStepSurroundings(
            self.wall, self._started, self.context, arguments, self._watch, self.until, self._alone
        )
        before, self._turn = self._turn, None
        with within(surroundings), self._watchdog.during(f"the making of node {self._started}"):
            node = make()
            for service in node.services:
                if "send_response" not in vars(service):  # of the lifecycle, which rclpy makes by itself
                    self._watch(service)
        executor = NodeExecutor(self.context, self._entities_changed)
        member = Member(node.get_name(), self._started, make, arguments, node, executor, loses)
        node.executor = executor
        self.step_ns = getattr(node, "step_ns", self.step_ns)
        self.members.append(member)
        self._changed = True
        self._turn = before
        self._join(member, set())
        self.drain()
        return member

    def subscribe(self, node: BaseNode, subscribe: Callable[[], Any]) -> Any:
        """Have a member make subscriptions between two steps; what is latched reaches them before this returns."""
        member = self._member_of(node)
        before = set(node.subscriptions)
        made = subscribe()
        self._join(member, before)
        self.drain()
        return made

    def observe_requests(self, node: BaseNode, service: str, callback: Callable[[Any], None]) -> None:
        """Have a member get each request for a service, too, when it is made, whether or not it arrives.

        Args:
            node: of the member.
            service: its absolute name.
            callback: called with the request, among the member's messages.
        """
        self._observed[service].append((self._member_of(node), callback))

    def _join(self, member: Member, known: set[Subscription]) -> None:
        """Take what was published while the member was made, and what is latched for it, by the times of publication.

        Args:
            member: that has just been made, or has new subscriptions.
            known: its subscriptions from before.
        """
        self._refresh()
        taken: list[tuple[int, Member, Subscription, Any]] = []
        came: defaultdict[Subscription, list[int]] = defaultdict(list)  # times of publication, ns
        owed = {sub: self._latched_for(member, sub) for sub in member.node.subscriptions if sub not in known}
        end = time.monotonic() + _JOIN_S
        while True:
            for other, sub in self._index.subscriptions:
                for message in entities.messages(sub):
                    at_ns = message[1]["source_timestamp"]
                    taken.append((at_ns, other, sub, message))
                    came[sub].append(at_ns)
            missing = [sub for sub, latched in owed.items() if not _complete(latched, came[sub])]
            if not missing:
                break
            if time.monotonic() > end:
                names = ", ".join(sub.topic_name for sub in missing)
                raise NodeFailed(f"{member.name}: what is latched on {names} has not arrived within {_JOIN_S:g} s")
            time.sleep(0.001)
        newest = {sub: sorted(came[sub])[-sub.qos_profile.depth :] for sub in owed}
        for at_ns, other, sub, message in sorted(taken, key=lambda one: one[0]):
            if sub not in owed or at_ns in newest[sub]:
                self._put(self._delivery(other, sub, message))

    def _latched_for(self, member: Member, sub: Subscription) -> list[deque[_Span]]:
        """What other members have published that the middleware keeps for a subscription that was made now."""
        if sub.qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL:
            return []
        name = sub.topic_name
        publishers = (p for other in self.members if other is not member for p in other.node.publishers)
        statuses = [deque([_ANY]) for server in self._with_statuses if server.statuses_name == name]
        return statuses + [self._latched[one] for one in publishers if one in self._latched and one.topic_name == name]

    def member(self, name: str) -> Member | None:
        """The node of that name that is there; None: none is."""
        return next((one for one in self.members if one.name == name and one.present), None)

    def _member_of(self, node: BaseNode) -> Member:
        return next(one for one in self.members if one.node is node)

    def remove(self, member: Member, last_messages: bool = True) -> None:
        """End a node, as a signal does; or as a kill does, without its last messages. What waits for it is lost."""
        if member.ending:
            return
        member.ending = True
        if last_messages and not member.node.silent:
            answers: list[Any] = []
            self._run(member, lambda: answers.extend(member.node.last_messages()))
            end_s = self.wall.now_s + LAST_MESSAGES_S
            self.drain()
            while not all(one.done() for one in answers) and self.wall.now_s < end_s and not self._closed:
                self.step()
            member.node.once.summary()
        member.present = False
        self.members.remove(member)
        self._queue = deque(one for one in self._queue if one.member is not member)
        self.losses.forget(member)
        for publisher in member.node.publishers:
            self._latched.pop(publisher, None)
        member.executor.shutdown()
        member.node.destroy_node()
        self._changed = True

    def close(self) -> None:
        """End all nodes that are left, without last messages, and ROS."""
        if self._closed:
            return
        self._closed = True
        self._watchdog.close()
        for member in self.members[::-1]:
            self.remove(member, last_messages=False)
        self.context.try_shutdown()

    # Faults

    def freeze(self, member: Member) -> None:
        """The node does not run any more; what comes for it waits."""
        member.frozen_s = self.wall.now_s

    def thaw(self, member: Member) -> None:
        """The node runs again."""
        member.frozen_s = None
        inbox, member.inbox = member.inbox, []
        self._queue.extend(inbox)

    # Time

    def step(self) -> None:
        """Let time go on by one step of the simulated robot, and have everything handled.

        Raises:
            NodeFailed: what a callback has raised.
        """
        self.wall.advance(self.step_ns)
        for delivery in self.losses.due(self.wall.now_s):
            self._put(delivery, again=True)
        self.drain()
        robot = self._robot()
        if robot is not None and robot.frozen_s is None:
            self._run(robot, robot.node.step)
            self._expire_goals()
            self.drain()
        for member in self.members[:]:
            if member.frozen_s is None and member.present:
                self._fire_timers(member)

    def _robot(self) -> Member | None:
        return next((one for one in self.members if hasattr(one.node, "step")), None)

    def _fire_timers(self, member: Member) -> None:
        self._refresh()
        for timer in self._index.timers[member]:
            with timer.handle:
                due = timer.handle.is_timer_ready()
                if due:
                    timer.handle.call_timer()
            if due and member.present and member.frozen_s is None:
                self._run(member, partial(entities.call, member, timer.callback))
                self.drain()

    def until(self, condition: Callable[[], object], limit_s: float) -> bool:
        """Step until the condition holds, at most so much simulated time, s; whether it does."""
        end_s = self.wall.now_s + limit_s
        while not condition():
            if self.wall.now_s >= end_s:
                return False
            self.step()
        return True

    def within(self, node: BaseNode, do: Callable[[], Any]) -> Any:
        """Have a member do something between two steps; what ``do`` returns."""
        member = self._member_of(node)
        results: list[Any] = []
        self._run(member, lambda: results.append(do()))
        self.drain()
        return results[0]

    def advance(self, seconds: float) -> None:
        """Let so much time pass, s."""
        self.until(lambda: False, seconds - 1e-6)

    # Messages

    def _watch(self, entity: Any) -> None:
        """Have what the entity sends taken at once by those who are to get it."""
        if isinstance(entity, Publisher):
            entity.publish = partial(self._publish, entity, entity.publish)
        elif isinstance(entity, Client):
            entity.call_async = partial(self._request, entity, entity.call_async)
        elif isinstance(entity, Service):
            entity.send_response = partial(self._respond, entity, entity.send_response)

    def _publish(self, publisher: Publisher, publish: Callable[[Any], None], message: Any) -> None:
        begin_ns = time.time_ns()
        publish(message)
        if publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            if publisher not in self._latched:
                self._latched[publisher] = deque(maxlen=publisher.qos_profile.depth)
            self._latched[publisher].append((begin_ns, time.time_ns()))
        if self._turn is not None:
            self._refresh()
            for member, sub in self._index.by_publisher(publisher):
                if (taken := entities.message(sub)) is not None:
                    self._put(self._delivery(member, sub, taken))

    def _request(self, client: Client, call: Callable[[Any], Any], request: Any) -> Any:
        self._refresh()
        name = self._index.name_of(client)
        for member, callback in self._observed.get(name, ()):
            self._queue.append(Delivery(member, callback, name, request, partial(callback, request), self._turn))
        answer = call(request)
        for member, service in self._index.services.get(name, ()):
            self._take(member, service)
        if ACTION in name:
            self._take_actions()
        return answer

    def _respond(self, service: Service, send: Callable[[Any, Any], None], response: Any, header: Any) -> None:
        send(response, header)
        self._refresh()
        for member, client in self._index.clients.get(self._index.name_of(service), ()):
            self._take(member, client)

    def _take(self, member: Member, entity: Subscription | Service | Client) -> None:
        for taken in entities.taken(entity):
            self._put(self._delivery(member, entity, taken))

    def _take_actions(self) -> None:
        """What actions' clients and servers have sent, which rclpy does not say in Python."""
        for member, client in self._index.clients_of_actions:
            self._take(member, client)
        for member, sub in self._index.topics_of_actions:
            while (taken := entities.message_if_any(sub)) is not None:
                self._put(self._delivery(member, sub, taken))
        for member, waitable in self._index.waitables:
            if isinstance(waitable, ActionServer) and waitable._goal_handles:
                self._with_statuses.add(waitable)
            while data := entities.data_of_action(waitable):
                self._put(self._delivery(member, waitable, data))

    def _expire_goals(self) -> None:
        """Have servers of actions forget the goals that ended 15 minutes ago."""
        self._refresh()
        for member, server in self._index.waitables:
            if not isinstance(server, ActionServer) or not server._goal_handles:  # without goals rcl raises
                continue
            if expired := server._handle.expire_goals(len(server._goal_handles)):
                self._put(self._delivery(member, server, {"expired": expired}))

    def take_all(self) -> None:
        """What others than the members have sent, too."""
        self._refresh()
        self._turn = None
        for member, sub in self._index.subscriptions:
            self._take(member, sub)
        for group in (self._index.services, self._index.clients):
            for pairs in group.values():
                for member, entity in pairs:
                    self._take(member, entity)
        self._take_actions()

    def _delivery(self, member: Member, entity: Any, taken: Any) -> Delivery:
        sender = self._turn
        if isinstance(entity, ActionServer | ActionClient):
            return Delivery(member, entity, "action", taken, partial(entities.execute, member, entity, taken), sender)
        name = self._index.name_of(entity)
        if isinstance(entity, Subscription):
            qos = self._index.qos[entity]
            arguments = taken[:1] if qos.message_only else taken
            handle = partial(entities.call, member, entity.callback, *arguments)
            return Delivery(member, entity, name, taken[0], handle, sender, qos.depth, qos.reliable, qos.latched)
        if isinstance(entity, Service):
            return Delivery(member, entity, name, taken[0], partial(entities.serve, member, entity, *taken), sender)
        return Delivery(member, entity, name, taken[1], partial(entities.answer, member, entity, *taken), sender)

    def _put(self, delivery: Delivery, again: bool = False) -> None:
        if not again and self.losses.holds(delivery, self.wall.now_s):
            return
        if delivery.member.frozen_s is not None:
            delivery.member.keep(delivery)
        else:
            self._queue.append(delivery)

    def drain(self) -> None:
        """Have everything handled that waits, and what follows from it.

        Raises:
            NodeFailed: what a callback has raised, or there is no end to it.
        """
        for _ in range(MOST_DELIVERIES):
            if not self._queue:
                return
            delivery = self._queue.popleft()
            member = delivery.member
            if not member.present:
                continue
            if member.frozen_s is not None:
                member.keep(delivery)
                continue
            self._refresh()
            if self._index.destroyed(delivery.entity):
                continue
            for witness in self.witnesses:
                witness(delivery)
            if delivery.name == CLOCK.name and entities.sets_time(delivery.entity):  # and sends nothing
                delivery.handle()
            else:
                self._run(member, delivery.handle)
        names = sorted({f"{one.member.name} ({one.name})" for one in self._queue})
        raise NodeFailed(f"no end to messages in one step, {MOST_DELIVERIES} so far; waiting: {', '.join(names)}")

    def _run(self, member: Member, handle: Callable[[], object]) -> None:
        before, self._turn = self._turn, member
        try:
            running = self._watchdog.begin(member.name)
            try:
                handle()
                member.executor.run_tasks()
            finally:
                self._watchdog.end(running)
            if member in self._index.with_actions:
                self._refresh()
                self._take_actions()
        except Exception as error:
            raise NodeFailed(f"{member.name}: {type(error).__name__}: {error}") from error
        finally:
            self._turn = before
        if member.node.status is not None and not member.ending:
            self.remove(member)
            self.ended(member)

    # Entities

    def _entities_changed(self) -> None:
        self._changed = True

    def _refresh(self) -> None:
        if self._changed:
            self._changed = False
            self._index = Index(self.members)
            self._with_statuses &= {waitable for _, waitable in self._index.waitables}


def _complete(latched: list[deque[_Span]], came_ns: list[int]) -> bool:
    """Whether all that is latched for a subscription has come, by the times of publication of what has."""
    spans = (span for one in latched for span in one)
    return all(any(begin_ns <= at_ns <= end_ns for at_ns in came_ns) for begin_ns, end_ns in spans)
