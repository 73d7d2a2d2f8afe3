"""Entities of members by name: take their messages from the middleware and handle them."""

import inspect
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from rclpy.action import ActionClient, ActionServer
from rclpy.client import Client
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.time_source import TimeSource

from ..rclpy_private import futures_of, mark_ready, run_callbacks_in, takes_message_alone
from .members import Delivery, Member

ACTION = "/_action/"  # part of the names of an action's topics and services
_Pairs = list[tuple[Member, Any]]


class Index:
    def __init__(self, members: list[Member]) -> None:
        self.subscriptions: _Pairs = [(m, one) for m in members for one in m.node.subscriptions]
        services = [(m, one) for m in members for one in m.node.services]
        clients = [(m, one) for m in members for one in m.node.clients]
        ends = ActionServer | ActionClient
        self.waitables = [(m, one) for m in members for one in m.node.waitables if isinstance(one, ends)]
        self.with_actions = {m for m, _ in self.waitables}
        self.timers = {m: list(m.node.timers) for m in members}
        self._names: dict[Any, str] = {}
        self.services, self.clients, self.by_topic = map(self._by_name, (services, clients, self.subscriptions))
        self.clients_of_actions = [(m, one) for m, one in clients if ACTION in self.name_of(one)]
        self.topics_of_actions = [(m, one) for m, one in self.subscriptions if ACTION in self.name_of(one)]
        self.all = [*self.subscriptions, *services, *clients]
        self._entities = {entity for _, entity in (*self.all, *self.waitables)}

    def _by_name(self, pairs: _Pairs) -> defaultdict[str, _Pairs]:
        pairs_by_name: defaultdict[str, _Pairs] = defaultdict(list)
        for member, entity in pairs:
            pairs_by_name[self.name_of(entity)].append((member, entity))
        return pairs_by_name

    def destroyed(self, entity: Any) -> bool:
        """Return True if the node has destroyed the entity since its message was taken."""
        kinds = Subscription | Service | Client | ActionServer | ActionClient
        return isinstance(entity, kinds) and entity not in self._entities

    def name_of(self, entity: Any) -> str:
        """Return the full name of the entity's topic or service."""
        if entity not in self._names:
            by_topic = isinstance(entity, Publisher | Subscription)
            self._names[entity] = entity.topic_name if by_topic else entity.service_name
        return self._names[entity]

    def delivery(self, member: Member, entity: Any, item: Any, sender: Member | None) -> Delivery:
        if isinstance(entity, ActionServer | ActionClient):
            return Delivery(member, entity, "action", item, partial(_execute, member, entity, item), sender)
        name = self.name_of(entity)
        if isinstance(entity, Service):
            return Delivery(member, entity, name, item[0], partial(_serve, member, entity, *item), sender)
        if isinstance(entity, Client):
            return Delivery(member, entity, name, item[1], partial(_answer, member, entity, *item), sender)
        handle = partial(call, member, entity.callback, *(item[:1] if takes_message_alone(entity) else item))
        return Delivery(member, entity, name, item[0], handle, sender)


def message(sub: Subscription) -> Any:
    """Take the next message of a subscription, with its times; None if no message has arrived."""
    with sub.handle:
        return sub.handle.take_message(sub.msg_type, sub.raw)


def message_if_any(sub: Subscription) -> Any:
    """Take the next message like ``message``, but faster if no message has arrived: no message object is created."""
    with sub.handle:
        one = sub.handle.take_message(sub.msg_type, True)
    return None if one is None else (deserialize_message(one[0], sub.msg_type), one[1])


def messages(entity: Subscription | Service | Client) -> Iterator[Any]:
    """Yield everything received: (message, its times), (request, header) or (header, response)."""
    if isinstance(entity, Subscription):
        while (one := message(entity)) is not None:
            yield one
        return
    with entity.handle:
        if isinstance(entity, Service):
            take = partial(entity.handle.service_take_request, entity.srv_type.Request)
        else:
            take = partial(entity.handle.take_response, entity.srv_type.Response)
        while (one := take())[0] is not None:
            yield one


def data_of_action(waitable: ActionServer | ActionClient) -> dict[str, Any]:
    """Take the data received by an action client or server; empty if there is none."""
    mark_ready(waitable)
    return {name: data for name, data in waitable.take_data().items() if data}


def sets_time(sub: Subscription) -> bool:
    """Return True for rclpy's own subscription that sets a node's clock."""
    return isinstance(getattr(sub.callback, "__self__", None), TimeSource)


def call(member: Member, callback: Callable[..., Any], *arguments: Any) -> None:
    result = callback(*arguments)
    if inspect.iscoroutine(result):
        member.executor.create_task(result)


def _serve(member: Member, service: Service, request: Any, header: Any) -> None:
    async def respond() -> None:
        response = service.callback(request, service.srv_type.Response())
        service.send_response(await response if inspect.isawaitable(response) else response, header)

    member.executor.create_task(respond)


def _answer(member: Member, client: Client, header: Any, response: Any) -> None:
    try:
        future = client.get_pending_request(header.request_id.sequence_number)
    except KeyError:  # no longer awaited
        return
    run_callbacks_in(member.executor, future)
    future.set_result(response)


def _execute(member: Member, waitable: ActionServer | ActionClient, data: dict[str, Any]) -> None:
    run_callbacks_in(member.executor, *futures_of(waitable))
    member.executor.create_task(waitable.execute, data)
