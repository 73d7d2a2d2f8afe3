"""Messages that wait until they are taken."""

import time

import rclpy

from pacman_env.ros import topics
from pacman_env.ros.selector.message_queue import MessageQueue
from tests.ros.system import Probe

WORDS = ["first", "second", "third"]


def test_queue_keeps_order_and_wakes_no_executor(probe: Probe) -> None:
    node = rclpy.create_node("sleeper", namespace=probe.system.namespace, context=probe.context)
    taken: list[tuple[str, float]] = []
    waiting = MessageQueue(node, topics.GAME_COMMAND, lambda message, waited_s: taken.append((message.data, waited_s)))
    probe.executor.add_node(node)
    began = time.time()
    for word in WORDS:
        probe.publish(topics.GAME_COMMAND, word)
    probe.taken_in(topics.GAME_COMMAND, "sleeper")
    arrived = time.time()
    probe.answered_by(f"{probe.system.namespace}/sleeper")
    assert taken == []
    shortest_s = time.time() - arrived
    waiting.catch_up()
    assert [word for word, _ in taken] == WORDS
    assert all(shortest_s <= waited_s <= time.time() - began for _, waited_s in taken)
    waiting.catch_up()
    assert len(taken) == 3
    waiting.destroy()
    probe.executor.remove_node(node)
    node.destroy_node()
