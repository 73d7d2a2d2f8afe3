"""Messages that wait until they are taken."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
import rclpy

from pacman_env.ros import topics
from pacman_env.ros.node import BaseNode
from pacman_env.ros.selector.message_queue import MessageQueue
from tests.ros import session
from tests.ros.system import Probe

WORDS = ["first", "second", "third"]


class Sleeper(BaseNode):
    """Has a queue, and what was taken from it, with how long it waited, s."""

    def __init__(self) -> None:
        super().__init__("sleeper")
        self.taken: list[tuple[str, float]] = []
        self.waiting = MessageQueue(self, topics.GAME_COMMAND, lambda message, s: self.taken.append((message.data, s)))


def test_queue_keeps_order_and_waiting_times(domain: int, tmp_path: Path) -> None:
    with session.nodes(tmp_path) as nodes:
        sleeper = nodes.start("sleeper", Sleeper).node
        assert isinstance(sleeper, Sleeper)
        for word in WORDS:
            nodes.publish(topics.GAME_COMMAND, word)
            nodes.advance(0.5)
        assert sleeper.taken == []
        nodes.within(sleeper.waiting.catch_up, sleeper)
        assert sleeper.taken == [(word, pytest.approx(s)) for word, s in zip(WORDS, (1.5, 1.0, 0.5), strict=True)]
        nodes.within(sleeper.waiting.catch_up, sleeper)
        assert len(sleeper.taken) == 3


def test_queue_wakes_no_executor(probe: Probe) -> None:
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
