"""How a session steps its nodes: the same seed is the same game, and nobody else meets its nodes."""

import random
import time
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context

from pacman_env.ros import topics
from pacman_env.ros.node import BaseNode
from tests.map_parts import part_of_map
from tests.ros import session
from tests.ros.session import Session

SETTINGS = ("show.start_s=1.0", "show.death_s=1.0", "power.pellets=1", "clyde.ghosts=wander,arcade")
#: All but ids, wall times and measured times.
RECORDED = (
    *(topics.GAME_STATE, topics.GAME_COMMAND, topics.GAME_RESULT, topics.GAME_EVENT, topics.GAME_STATUS),
    *(topics.GAME_LIGHT, topics.GAME_SOUND, topics.LIGHT_RING, topics.CMD_VEL, topics.WHY),
    *(topics.PELLET_MARKERS, topics.REMOVE_PELLET, topics.HARMLESS_GHOSTS, *topics.GHOST_POSES[:2]),
    *(topics.AMCL_POSE, topics.ODOMETRY),
)


class Echo(BaseNode):
    """Answers each event with a light and a sound, in this order, and remembers what it handles."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.words: list[str] = []
        self.light, self.sound = topics.GAME_LIGHT.publisher(self), topics.GAME_SOUND.publisher(self)
        self.listen(topics.GAME_EVENT, self._event, "bad event")
        self.listen(topics.GAME_STATE, lambda message: self.words.append(message.data), "bad state")

    def _event(self, message: Any) -> None:
        self.words.append(message.data)
        self.light.publish(topics.GAME_LIGHT.type(data=message.data))
        self.sound.publish(topics.GAME_SOUND.type(data=message.data))


def echo(nodes: Session, name: str) -> Echo:
    node: Echo = nodes.start(name, lambda **options: Echo(name, **options))
    return node


def test_messages_are_handled_in_order_of_publication(nodes: Session) -> None:
    nodes.record(topics.GAME_SOUND, topics.GAME_LIGHT)
    for name in ("one", "two"):
        echo(nodes, name)
    event = topics.GAME_EVENT.publisher(nodes.observer)
    nodes.within(lambda: [event.publish(topics.GAME_EVENT.type(data=word)) for word in ("a", "b")])
    light, sound = topics.GAME_LIGHT.name, topics.GAME_SOUND.name
    expected = [(topic, word) for word in ("a", "a", "b", "b") for topic in (light, sound)]
    assert [(one.topic, one.value) for one in nodes.records] == expected


def test_late_node_gets_latched_messages_first(nodes: Session) -> None:
    nodes.publish(topics.GAME_STATE, "menu")
    nodes.publish(topics.GAME_STATE, "running")
    nodes.publish(topics.GAME_EVENT, "too early")
    late = echo(nodes, "late")
    nodes.publish(topics.GAME_EVENT, "in time")
    assert late.words == ["running", "in time"]


def played(folder: Path, seed: int, is_slow: bool = False) -> list[tuple[float, str, str]]:
    """Play one game; on a slow machine each step takes some real time, now more, now less."""
    folder.mkdir()
    ground = part_of_map("house", 3.0).save(folder / "ground.yaml")
    with session.game(folder, ground, seed=seed, settings=SETTINGS) as game:
        game.record(*RECORDED)
        assert game.call(topics.START_GAME).success
        game.clear()

        def is_over() -> bool:
            time.sleep(0.004 * random.random() if is_slow else 0.0)
            return "menu" in game.values(topics.GAME_STATE)

        game.wait_for(is_over, 900, "the end of the game")
        assert game.errors() == []
        return [(round(one.at, 3), one.topic, str(one.message)) for one in game.records]


def test_same_seed_is_same_game_message_for_message(domain: int, tmp_path: Path) -> None:
    first, other = played(tmp_path / "idle", 3), played(tmp_path / "other", 4)
    again = played(tmp_path / "slow", 3, is_slow=True)
    assert first == again
    assert first != other


def test_nodes_alone_meet_no_other_process(nodes: Session) -> None:
    context = Context()
    rclpy.init(context=context)
    try:
        other = rclpy.create_node("other", context=context)
        assert other.get_node_names() == ["other"]
        assert "other" not in nodes.observer.get_node_names()
        other.destroy_node()
    finally:
        context.try_shutdown()
