"""Messages of a game become its state: the newest valid value of each topic, for every reader alike."""

import json
import math
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.ros import topics
from pacman_env.ros.game_monitor import MONITORED, GameMonitor
from pacman_env.ros.message_conversion import BadMessage, markers_of, pose_message

STAMP = Time(sec=12, nanosec=500_000_000)
PROCESS: dict[str, Any] = {
    "node": "audio_node",
    "started": [5.0, "laptop", 17],
    "map": None,
    "hash": "abc",
    "configuration": {},
}
STARTED = {"processes": {"watcher": "was killed"}, "event": "watcher was killed", "number": 1}


def receive(game: GameMonitor, name: str, data: Any, now_s: float = 0.0) -> None:
    topic = MONITORED[name].topic
    text = json.dumps(data) if isinstance(data, dict) else data
    game.update(topic.name, topic.type(data=text), now_s)


@pytest.mark.parametrize(
    ("name", "data", "value"),
    [
        ("state", " Running", "running"),
        ("result", "Complete\x1b[2J\n - Score: 3", "Complete [2J - Score: 3"),
        ("round", 1, 1),
        ("pellets_collected", 0, 0),
        ("ghosts_caught", 2, 2),
        ("clyde_speed_mps", 0.25, 0.25),
        ("condition", {"policy": "ppo"}, {"policy": "ppo"}),
        ("started", {**STARTED, "event": "no\x1b\n answer"}, {**STARTED, "event": "no answer"}),
        ("configuration", PROCESS, {**PROCESS, "acts": False, "rules": None, "started": (5.0, "laptop", 17)}),
    ],
)
def test_valid_message_becomes_value_of_its_topic(name: str, data: Any, value: Any) -> None:
    game = GameMonitor()
    receive(game, name, data)
    assert getattr(game, name) == game.valid(name) == value


@pytest.mark.parametrize(
    ("name", "data", "bad", "words"),
    [
        ("state", "menu", "nonsense", "unknown word 'nonsense'"),
        ("round", 3, 0, "must be within 1 and"),
        ("score", 3, -3, "must be within 0 and"),
        ("clyde_speed_mps", 0.25, math.nan, "must be within 0 and"),
        ("condition", {"policy": "ppo"}, "no json", "no JSON"),
        ("condition", {"policy": "ppo"}, "[" * 200_000, "at most 100000"),
        ("started", STARTED, {**STARTED, "processes": 3}, "not the processes"),
        ("configuration", PROCESS, {**PROCESS, "started": ["late", "pi", 17]}, "no process"),
        ("configuration", PROCESS, {**PROCESS, "configuration": 3}, "not the configuration"),
    ],
)
def test_invalid_message_leaves_value_but_not_valid(name: str, data: Any, bad: Any, words: str) -> None:
    game = GameMonitor()
    receive(game, name, data)
    value = getattr(game, name)
    with pytest.raises(BadMessage, match=words):
        receive(game, name, bad)
    assert words in game.invalid[name]
    assert game.valid(name) is None
    assert getattr(game, name) == value
    receive(game, name, data)
    assert game.invalid == {}
    assert game.valid(name) == value


def test_troubles_are_those_of_selector() -> None:
    game, texts = GameMonitor(), {"pose lost": "pose lost: 4 s"}
    receive(game, "condition", {"troubles": {"pose lost": 3, "late": 1}, "trouble_texts": texts})
    assert game.troubles == {**texts, "late": "late"}
    receive(game, "condition", {"troubles": [3]})  # of another project
    assert game.troubles == {}


def test_restarted_node_has_two_processes_and_newest_configuration() -> None:
    game = GameMonitor()
    receive(game, "configuration", PROCESS)
    receive(game, "configuration", {**PROCESS, "node": "sim_robot"})
    receive(game, "configuration", {**PROCESS, "started": [9.0, "laptop", 18], "hash": "def"})
    assert [key for key in game.processes if key[0] == "audio_node"] == [
        ("audio_node", (5.0, "laptop", 17)),
        ("audio_node", (9.0, "laptop", 18)),
    ]
    assert {name: one["hash"] for name, one in game.nodes.items()} == {"audio_node": "def", "sim_robot": "abc"}
    for number in range(200):  # of a node that is started again and again
        receive(game, "configuration", {**PROCESS, "started": [9.0, "laptop", number]})
    assert len(game.processes) == 100


def test_pellets_and_poses_carry_positions_and_stamps() -> None:
    game = GameMonitor()
    game.update(topics.PELLET_MARKERS.name, markers_of({4: (1.0, 2.0)}, STAMP))
    game.update(topics.GHOST_POSES[1].name, pose_message(3.0, 4.0, 0.0, STAMP))
    game.update(topics.GAME_COMMAND.name, topics.GAME_COMMAND.type(data="enable"))  # of no value of the game
    assert game.pellets == {4: (1.0, 2.0)}
    assert game.ghosts == {1: ((3.0, 4.0, 0.0), 12_500_000_000)}
    with pytest.raises(BadMessage, match="frame 'odom'"):
        game.update(topics.GHOST_POSES[1].name, pose_message(9.0, 4.0, 0.0, STAMP, "odom"))
    assert game.ghosts[1][0] == (3.0, 4.0, 0.0)


@given(st.lists(st.sampled_from(sorted(topics.STATE_WORDS)), max_size=20))
def test_state_begins_with_its_first_message(states: list[str]) -> None:
    game, began_s, previous = GameMonitor(), 0.0, ""
    for now_s, state in enumerate(states, 1):
        receive(game, "state", state, float(now_s))
        if state != previous:
            began_s = float(now_s)
        previous = state
        assert (game.state, game.began_s) == (state, began_s)
