"""Nodes that join a lock-step game get what is latched, all of it and once; nodes that are gone leave nothing."""

import gc
from pathlib import Path

import pytest

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import SELECTOR
from pacman_env.ros.node import BaseNode
from tests.ros import scripted_nav2, session
from tests.ros.session import Session


class Talker(BaseNode):
    """Publishes its name on a latched topic while it is made, and keeps what it gets there."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.words: list[str] = []
        publisher = topics.OPERATOR_STOP.publisher(self)
        self.listen(topics.OPERATOR_STOP, lambda message: self.words.append(message.data), "bad word")
        publisher.publish(topics.OPERATOR_STOP.type(data=name))


class Listener(BaseNode):
    """Keeps what it gets on ``game_command``, in order; ``depth`` is that of its subscription."""

    def __init__(self, depth: int) -> None:
        super().__init__(f"listener_{depth}")
        self.words: list[str] = []
        qos = topics.LATCHED if depth == 1 else topics.COMMANDS
        topic = topics.GAME_COMMAND
        self.create_subscription(topic.type, topic.name, lambda message: self.words.append(message.data), qos)


def test_node_gets_latched_messages_while_it_is_made(nodes: Session) -> None:
    names = [f"talker_{k}" for k in range(8)]
    for name in names:
        nodes.start(name, lambda name=name: Talker(name))
    for name in names:
        assert nodes.node(name).words == names  # in the order of publication


@pytest.mark.parametrize("depth", [1, 32])
def test_new_node_gets_latched_messages_up_to_its_depth(nodes: Session, depth: int) -> None:
    publishers = [
        topics.GAME_COMMAND.publisher(nodes.start(name, lambda name=name: Talker(name)).node) for name in "ab"
    ]
    words = [f"word {k}" for k in range(50)]
    for k, word in enumerate(words):
        nodes.within(lambda k=k, word=word: publishers[k % 2].publish(topics.GAME_COMMAND.type(data=word)))
    for _ in range(20):
        nodes.start("listener", lambda: Listener(depth))
        assert nodes.node(f"listener_{depth}").words == words[-depth:]  # by time of publication
        nodes.kill(f"listener_{depth}")


def test_killed_node_leaves_log_to_its_successor(domain: int, tmp_path: Path) -> None:
    with session.game(tmp_path) as game:
        killed = game.member(SELECTOR)
        game.kill(SELECTOR)
        game.game.start(SELECTOR)  # type: ignore[attr-defined]
        del killed
        gc.collect()
        game.node(SELECTOR).get_logger().error("an error")
        assert game.errors() == ["robot_15.goal_selector: an error"]


def test_action_of_removed_node_is_gone(nodes: Session) -> None:
    nodes.start(scripted_nav2.NAME, scripted_nav2.ScriptedNav2)
    client = topics.NAVIGATE_TO_POSE.client(nodes.observer)
    assert client.server_is_ready()
    nodes.kill(scripted_nav2.NAME)
    assert not client.server_is_ready()
    client.destroy()
