"""Messages that wait until somebody looks."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest

rclpy = pytest.importorskip("rclpy")

from pacman_env.ros import topics  # noqa: E402
from pacman_env.ros.selector.message_queue import MessageQueue  # noqa: E402

if TYPE_CHECKING:
    from tests.ros.system import Probe


def test_they_wake_nobody_and_are_taken_in_order_with_how_long_they_waited(probe: Probe) -> None:
    node = rclpy.create_node("sleeper", namespace=probe.system.namespace, context=probe.context)
    taken: list[tuple[str, float]] = []
    waiting = MessageQueue(node, topics.GAME_COMMAND, lambda message, waited_s: taken.append((message.data, waited_s)))
    probe.executor.add_node(node)
    began = time.monotonic()
    for word in ("first", "second", "third"):
        probe.publish(topics.GAME_COMMAND, word)
    probe.taken_in(topics.GAME_COMMAND, "sleeper")
    probe.spin(0.2)
    assert taken == []
    waiting.catch_up()
    assert [word for word, _ in taken] == ["first", "second", "third"]
    assert all(0.2 <= waited_s <= time.monotonic() - began for _, waited_s in taken)
    waiting.catch_up()
    assert len(taken) == 3
    waiting.destroy()
    probe.executor.remove_node(node)
    node.destroy_node()
