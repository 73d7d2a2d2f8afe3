"""The entities of members, by their names: how what has come for one is taken from the middleware, and handled."""

from __future__ import annotations

import inspect
from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any

from rclpy.action import ActionClient, ActionServer
from rclpy.client import Client
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.time_source import TimeSource

from .members import Member

ACTION = "/_action/"  # in the names of an action's topics and services


class Qos:
    """What decides about a subscription's messages."""

    def __init__(self, sub: Subscription) -> None:
        profile = sub.qos_profile
        self.depth = int(profile.depth)
        self.reliable = profile.reliability != ReliabilityPolicy.BEST_EFFORT
        self.latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        self.message_only = sub._callback_type is Subscription.CallbackType.MessageOnly


class Index:
    """The entities of all members by the names of their topics and services."""

    def __init__(self, members: list[Member] | None = None) -> None:
        members = members or []
        self.subscriptions = [(m, sub) for m in members for sub in m.node.subscriptions]
        self.services = _by_name((m, one) for m in members for one in m.node.services)
        self.clients = _by_name((m, one) for m in members for one in m.node.clients)
        self.waitables = [
            (m, one) for m in members for one in m.node.waitables if isinstance(one, ActionServer | ActionClient)
        ]
        self.with_actions = {m for m, _ in self.waitables}
        self.timers = {m: list(m.node.timers) for m in members}
        self.qos = {sub: Qos(sub) for _, sub in self.subscriptions}
        self._names: dict[Any, str] = {}
        self._by_topic: defaultdict[str, list[tuple[Member, Subscription]]] = defaultdict(list)
        for member, sub in self.subscriptions:
            self._by_topic[self.name_of(sub)].append((member, sub))
        self.clients_of_actions = [
            (m, one) for name, pairs in self.clients.items() if ACTION in name for m, one in pairs
        ]
        self.topics_of_actions = [(m, sub) for m, sub in self.subscriptions if ACTION in self.name_of(sub)]

        groups = (*self.services.values(), *self.clients.values(), self.subscriptions, self.waitables)
        self._entities = {entity for pairs in groups for _, entity in pairs}

    def destroyed(self, entity: Any) -> bool:
        """Whether it is an entity that its node has destroyed since something came for it."""
        kinds = Subscription | Service | Client | ActionServer | ActionClient
        return isinstance(entity, kinds) and entity not in self._entities

    def name_of(self, entity: Any) -> str:
        """The full name of its topic or service."""
        if entity not in self._names:
            by_topic = isinstance(entity, Publisher | Subscription)
            self._names[entity] = entity.topic_name if by_topic else entity.service_name
        return self._names[entity]

    def by_publisher(self, publisher: Publisher) -> list[tuple[Member, Subscription]]:
        """The subscriptions of its topic."""
        return self._by_topic.get(self.name_of(publisher), [])


def _by_name(pairs: Iterator[tuple[Member, Any]]) -> dict[str, list[tuple[Member, Any]]]:
    found: defaultdict[str, list[tuple[Member, Any]]] = defaultdict(list)
    for member, entity in pairs:
        found[entity.service_name].append((member, entity))
    return dict(found)


def message(sub: Subscription) -> Any:
    """A message and its times; None: there is none."""
    with sub.handle:
        return sub.handle.take_message(sub.msg_type, sub.raw)


def message_if_any(sub: Subscription) -> Any:
    """The same, for topics on which there mostly is none: an attempt to take bytes makes no message in vain."""
    with sub.handle:
        one = sub.handle.take_message(sub.msg_type, True)
    return None if one is None else (deserialize_message(one[0], sub.msg_type), one[1])


def messages(sub: Subscription) -> Iterator[Any]:
    """All messages that have come, with their times."""
    while (one := message(sub)) is not None:
        yield one


def taken(entity: Subscription | Service | Client) -> Iterator[Any]:
    """All that has come for an entity: (message, its times), (request, header) or (header, response)."""
    if isinstance(entity, Subscription):
        yield from messages(entity)
        return
    with entity.handle:
        if isinstance(entity, Service):
            while (one := entity.handle.service_take_request(entity.srv_type.Request))[0] is not None:
                yield one
        else:
            while (one := entity.handle.take_response(entity.srv_type.Response))[0] is not None:
                yield one


#: Flags of rclpy's ends of actions, which a wait set would set. A wait set takes a millisecond each time, an attempt to
#: take what is not there a microsecond.
_READY = {
    ActionServer: ("_is_goal_request_ready", "_is_cancel_request_ready", "_is_result_request_ready"),
    ActionClient: (
        *("_is_goal_response_ready", "_is_cancel_response_ready", "_is_result_response_ready"),
        *("_is_feedback_ready", "_is_status_ready"),
    ),
}


def data_of_action(waitable: ActionServer | ActionClient) -> dict[str, Any]:
    """What has come for an action's end; empty: nothing."""
    if isinstance(waitable, ActionServer):
        waitable._is_goal_expired = False
    for flag in _READY[type(waitable)]:
        setattr(waitable, flag, True)
    return {name: data for name, data in waitable.take_data().items() if data}


def sets_time(sub: Subscription) -> bool:
    """Whether it is rclpy's own, which sets a node's clock."""
    return isinstance(getattr(sub.callback, "__self__", None), TimeSource)


def call(member: Member, callback: Callable[..., Any], *arguments: Any) -> None:
    """Call a member's callback; a coroutine becomes a task of its executor."""
    result = callback(*arguments)
    if inspect.iscoroutine(result):
        member.executor.create_task(result)


def serve(member: Member, service: Service, request: Any, header: Any) -> None:
    """Have a service's callback answer a request."""

    async def respond() -> None:
        response = service.callback(request, service.srv_type.Response())
        service.send_response(await response if inspect.isawaitable(response) else response, header)

    member.executor.create_task(respond)


def answer(member: Member, client: Client, header: Any, response: Any) -> None:
    """Have a client's future done, if it is still waited for."""
    try:
        future = client.get_pending_request(header.request_id.sequence_number)
    except KeyError:
        return
    future._set_executor(member.executor)
    future.set_result(response)


def execute(member: Member, waitable: ActionServer | ActionClient, data: dict[str, Any]) -> None:
    """Have an action's end do what its data ask for."""
    for future in waitable._futures:
        future._set_executor(member.executor)
    member.executor.create_task(waitable.execute, data)
