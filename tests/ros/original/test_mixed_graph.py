"""Each of our nodes in turn gives its place to the original's: two rounds, and every pellet counts.

One whole game in lock-step serves every test; nodes are exchanged in the menu. Clyde is slow, and nearly everywhere
where it can appear there is no way to the robot. What a burst of the original referee's commands does between processes
is in ``test_original_referee.py``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from geometry_msgs.msg import PointStamped
from std_msgs.msg import Header

from pacman_env.ros import topics
from pacman_env.ros.messages import pellets_of, pose_of
from pacman_env.ros.node import BaseNode
from pacman_env.ros.simulated_robot.sim_robot import AUDIO_SHOWN, FAULT, LIGHT_RING_SHOWN
from pacman_env.ros.supervisor.game_nodes import SELECTOR
from tests.ros import session
from tests.ros.original import (
    audio_node,
    clyde_ghost_node,
    game_controller,
    game_event_mapper,
    game_light_node,
    pellet_manager,
    planner_stub,
)
from tests.ros.original.corridor import AWAY, CLYDE_MPS, PELLETS, SETTINGS, corridor

TRIES = 4  # Clyde may end a round
HOME = 0.0, 0.0, 0.0
POLICY = "nearest"
#: By the name of our node in whose place it comes.
ORIGINALS: dict[str, Any] = {
    "pellet_manager": pellet_manager.PelletManager,
    "clyde_ghost_node": clyde_ghost_node.ClydeGhostNode,
    "game_controller": game_controller.GameController,
    SELECTOR: planner_stub.PlannerStub,
    "game_event_mapper": game_event_mapper.GameEventMapper,
    "game_light_node": game_light_node.GameLightNode,
    "audio_node": audio_node.AudioNode,
}
NODE_NAMES = {SELECTOR: "planner_stub"}  # of the originals, where it is another one than ours
WITH_MAP = ("pellet_manager", "clyde_ghost_node", SELECTOR)
RECORDED = (
    *(topics.GAME_STATE, topics.GAME_RESULT, topics.SCORE, topics.ROUND, topics.PELLETS_SPAWNED),
    *(topics.PELLETS_COLLECTED, topics.GAME_STATUS, topics.REMOVE_PELLET, topics.PELLET_MARKERS, topics.CLYDE_POSE),
    *(topics.GAME_LIGHT, topics.CMD_VEL, LIGHT_RING_SHOWN, AUDIO_SHOWN),
)


def hosted(original: Any) -> Callable[[], BaseNode]:
    """Makes a node of the original's as one of a lock-step game: what it does is its own."""
    return type(original.__name__, (original, BaseNode), {})


class Mixed:
    """The whole game, of which one node at a time is the original's."""

    def __init__(self, nodes: session.Session, map: str) -> None:
        self.nodes, self.map = nodes, map
        nodes.record(*RECORDED)
        nodes.publish(topics.BASE_CLYDE_SPEED, CLYDE_MPS)

    def end(self, name: str) -> None:
        """Have a node end in order."""
        member = self.nodes.game.member(name)
        assert member is not None
        self.nodes.game.remove(member)

    def to_the_originals(self, name: str) -> None:
        """One of our nodes goes, the original's comes."""
        self.end(name)
        parameters = {"map_yaml": self.map} if name in WITH_MAP else {}
        self.nodes.start(NODE_NAMES.get(name, name), hosted(ORIGINALS[name]), **parameters)

    def to_ours(self, name: str) -> None:
        """The way back."""
        self.end(NODE_NAMES.get(name, name))
        parameters: dict[str, Any] = {"map_yaml": self.map} if name in WITH_MAP else {}
        if name == SELECTOR:
            parameters |= {"policy": POLICY, "home": list(HOME)}
        self.nodes.start(name, settings=list(SETTINGS), **parameters)

    def wait(self, condition: Callable[[], Any], what: str) -> Any:
        """Simulated s."""
        return self.nodes.wait_for(condition, 300.0, what)

    def value(self, topic: topics.Topic) -> Any:
        """The last, be it forgotten or not."""
        message = self.nodes.latest(topic)
        return None if message is None else message.data

    def reset(self) -> None:
        """To the menu, with all pellets, score 0 and round 1."""
        assert self.nodes.call(topics.RESET_GAME).success
        wanted = (topics.GAME_STATE, "menu"), (topics.SCORE, 0), (topics.ROUND, 1), (topics.PELLETS_SPAWNED, PELLETS)
        self.wait(lambda: all(self.value(topic) == value for topic, value in wanted), "the menu")
        self.wait(lambda: len(pellets_of(self.nodes.latest(topics.PELLET_MARKERS))) == PELLETS, "the pellets")
        self.nodes.advance(2.0)  # a planner has seen them

    def two_rounds(self) -> list[list[int]]:
        """Both completed, from score 0; in each the numbers of pellets spawned and collected, and the scores."""
        for _ in range(TRIES):
            self.reset()
            played: list[list[int]] = []
            for number in (1, 2):
                numbers = self.round(number)
                if numbers is None:
                    break
                played += numbers
            else:
                return played
        raise AssertionError(f"Clyde has ended one of two rounds {TRIES} times")

    def put_clyde_away(self) -> None:
        """Into a room without a door; the original's leaves it with the reset of a round, for anywhere."""
        point = PointStamped(header=Header(frame_id="map"))
        point.point.x, point.point.y = AWAY
        self.nodes.publish(topics.CLICKED_POINT, point)
        self.wait(lambda: math.dist(pose_of(self.nodes.latest(topics.CLYDE_POSE))[:2], AWAY) < 0.1, "Clyde")

    def round(self, number: int, meanwhile: Callable[[], None] = lambda: None) -> list[list[int]] | None:
        """One round from the call to the menu, something done from the start show on; None: Clyde has ended it."""
        nodes = self.nodes
        self.put_clyde_away()
        nodes.forget()
        assert nodes.call(topics.START_GAME).success
        self.wait(lambda: "starting" in nodes.values(topics.GAME_STATE), "the start show")
        meanwhile()
        self.wait(lambda: "running" in nodes.values(topics.GAME_STATE), "the round")
        self.wait(lambda: self.value(topics.GAME_STATE) not in ("starting", "running"), "the end of the round")
        lost = "dying" in nodes.values(topics.GAME_STATE)
        self.wait(lambda: self.value(topics.GAME_STATE) == "menu", "the menu")
        if lost:
            return None
        assert self.value(topics.ROUND) == number + 1
        assert f"Complete - Score: {self.value(topics.SCORE)}" in nodes.values(topics.GAME_RESULT)
        return [nodes.values(topic) for topic in (topics.PELLETS_SPAWNED, topics.PELLETS_COLLECTED, topics.SCORE)]


@pytest.fixture(scope="module")
def whole(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mixed]:
    folder = tmp_path_factory.mktemp("game")
    map = corridor().save(folder / "corridor.yaml")
    with session.game(folder, map, POLICY, seed=1, settings=SETTINGS, home=HOME) as nodes:
        yield Mixed(nodes, str(map))
        assert nodes.errors() == []


@pytest.fixture
def mixed(whole: Mixed, request: pytest.FixtureRequest) -> Iterator[Mixed]:
    """With the original's node of that name."""
    whole.to_the_originals(request.param)
    yield whole
    whole.to_ours(request.param)


#: Each in its turn, with ``--daily``; else those that the rounds depend on.
MIXED = [
    pytest.param(name, marks=() if name in ("pellet_manager", "game_controller") else pytest.mark.daily)
    for name in ORIGINALS
]


@pytest.mark.parametrize("mixed", MIXED, indirect=True)
def test_with_one_node_of_the_originals_two_rounds_end_with_every_pellet_counted(mixed: Mixed) -> None:
    played = mixed.two_rounds()
    for number, (spawned, collected, score) in enumerate(zip(*[iter(played)] * 3, strict=True), 1):
        assert set(spawned) - {0} == {PELLETS}
        assert max(collected) == PELLETS
        assert max(score) == number * PELLETS
        assert score == sorted(score)
    nodes = mixed.nodes
    assert {"start", "pellet", "win"} <= set(nodes.values(topics.GAME_LIGHT))
    rings = [json.loads(text) for text in nodes.values(LIGHT_RING_SHOWN)]
    assert any(one["override_system"] for one in rings)
    melodies = [json.loads(text) for text in nodes.values(AUDIO_SHOWN)]
    assert any(len(one.get("notes", ())) == 29 for one in melodies)  # the theme
    assert any(abs(twist.twist.angular.z) > 1.0 for twist in nodes.messages(topics.CMD_VEL))  # the spin


@pytest.mark.parametrize("mixed", [SELECTOR], indirect=True)
def test_pellets_that_the_originals_planner_drops_uncounted_hold_no_round_up(mixed: Mixed) -> None:
    """It removes a pellet that Nav2 has aborted; of that the referee learns by ``game_complete`` alone."""
    nodes = mixed.nodes

    def dropped() -> set[int]:
        reported = {int(word.partition(":")[2]) for word in nodes.values(topics.GAME_STATUS) if ":" in word}
        return set(nodes.values(topics.REMOVE_PELLET)) - reported

    def abort() -> None:
        """The robot's way to the first pellet."""
        nodes.publish(FAULT, "abort 0.2")
        mixed.wait(dropped, "a pellet to be dropped")
        nodes.publish(FAULT, "end abort")

    for _ in range(TRIES):  # Clyde may end a round
        mixed.reset()
        numbers = mixed.round(1, abort)
        lost = len(dropped())
        if numbers is None:
            continue
        spawned, _, score = numbers
        assert lost
        assert set(spawned) - {0} == {PELLETS}
        assert score[-1] == PELLETS - lost
        numbers = mixed.round(2)
        if numbers is not None:
            assert max(numbers[2]) == PELLETS - lost + PELLETS
            return
    raise AssertionError(f"no two rounds to look at in {TRIES} tries")
