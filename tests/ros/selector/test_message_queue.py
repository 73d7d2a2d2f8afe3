"""Messages that wait until they are taken."""

import time

import rclpy

from pacman_env.ros import topics
from pacman_env.ros.node import BaseNode
from pacman_env.ros.selector.message_queue import MessageQueue
from tests.ros.session import Session
from tests.ros.system import Probe

WORDS = [f"message {number}" for number in range(topics.GAME_COMMAND.qos.depth + 2)]


def test_queue_keeps_newest_messages_in_order(probe: Probe) -> None:
    node = rclpy.create_node("sleeper", namespace=probe.system.namespace, context=probe.context)
    taken: list[tuple[str, float]] = []
    waiting = MessageQueue(node, topics.GAME_COMMAND, lambda message, waited_s: taken.append((message.data, waited_s)))
    probe.executor.add_node(node)
    began = time.monotonic()
    for word in WORDS:
        probe.publish(topics.GAME_COMMAND, word)
        probe.taken_in(topics.GAME_COMMAND, "sleeper")
    arrived = time.monotonic()
    probe.answered_by(f"{probe.system.namespace}/sleeper")
    assert taken == []
    shortest_s = time.monotonic() - arrived
    waiting.catch_up()
    assert [word for word, _ in taken] == WORDS[2:]
    assert all(shortest_s <= waited_s <= time.monotonic() - began for _, waited_s in taken)
    waiting.catch_up()
    assert len(taken) == len(WORDS) - 2
    probe.executor.remove_node(node)
    node.destroy_node()


def test_message_before_first_clock_has_no_age(nodes: Session) -> None:
    waited: list[float] = []
    nodes.clock_runs = False
    node = nodes.start("page", lambda **options: BaseNode("page", **options))
    queue = MessageQueue(node, topics.GAME_COMMAND, lambda message, waited_s: waited.append(waited_s), node.now_s)
    nodes.publish(topics.GAME_COMMAND, "early")
    nodes.clock_runs = True
    nodes.advance(0.05)
    nodes.publish(topics.GAME_COMMAND, "late")
    queue.catch_up()
    assert waited == [0.0]
