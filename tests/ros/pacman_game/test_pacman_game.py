"""The game of one process: its services, what it says and in which order, what it saves and resumes."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pacman_env.config import PelletConfig
from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.game.pellets import generate_pellets
from pacman_env.game.round import RoundController
from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME
from pacman_env.ros.message_conversion import pellets_of
from pacman_env.ros.pacman_game.state_file import StateFile
from pacman_env.ros.process import CRASHED, STOOD_STILL
from pacman_env.world.maps.occupancy import load_map
from tests.ros.session import Session

SAID = (
    *(topics.GAME_STATE, topics.GAME_COMMAND, topics.GAME_RESULT, topics.GAME_EVENT),
    *(topics.SCORE, topics.ROUND, topics.PELLETS_SPAWNED, topics.PELLETS_COLLECTED, topics.CLYDE_SPEED),
)
LATCHED = tuple(topic for topic in SAID if topic is not topics.GAME_EVENT)
QUICK = ["show.start_s=0.2", "show.death_s=0.2"]


@pytest.fixture(autouse=True)
def state_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where games are saved."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state"


def up(nodes: Session, *settings: str, **parameters: Any) -> None:
    """Start a game whose goal selector is the test."""
    nodes.record(*SAID)
    own = {"map_yaml": "house", "selector": "none", "state_file": "auto", "settings": [*QUICK, *settings]}
    nodes.start(GAME, **{**own, **parameters})
    nodes.advance(0.1)
    assert all(nodes.values(topic) for topic in LATCHED)


def status(nodes: Session, word: str) -> None:
    nodes.publish(topics.GAME_STATUS, word)


def wait_state(nodes: Session, state: str) -> None:
    nodes.wait_for(lambda: nodes.values(topics.GAME_STATE)[-1:] == [state], 10.0, f"state {state}")


def running(nodes: Session) -> None:
    """One round, begun."""
    assert nodes.call(topics.START_GAME).success
    assert nodes.value(topics.GAME_STATE) == "returning_home"
    status(nodes, "home_reached")
    wait_state(nodes, "running")


def test_late_node_gets_all_latched_values(nodes: Session) -> None:
    nodes.start(GAME, map_yaml="house", settings=["clyde.speed_mps=0.3"])
    nodes.advance(10.0)
    nodes.record(*SAID)
    latest = {topic.name: nodes.value(topic) for topic in LATCHED}
    assert latest.pop("clyde/speed") == pytest.approx(0.3)
    assert latest == {
        "game_state": "menu",
        "game_command": "disable",
        "game_result": "",
        "game/score": 0,
        "game/round": 1,
        "game/pellets_spawned": 13,
        "game/pellets_collected": 0,
    }


def test_start_is_refused_during_game(nodes: Session) -> None:
    up(nodes)
    begun = nodes.call(topics.START_GAME)
    assert (begun.success, begun.message) == (True, "a round begins: the robot drives home first")
    again = nodes.call(topics.START_GAME)
    assert not again.success
    assert "returning_home" in again.message
    back = nodes.call(topics.RESET_GAME)
    assert (back.success, back.message) == (True, "the game is reset: it is in the menu")
    assert nodes.value(topics.GAME_STATE) == "menu"


def test_start_is_refused_without_pose_or_foreign_selector(nodes: Session) -> None:
    for selector, why in (("ours", "the robot has no pose yet"), ("original", "no goal selector yet")):
        up(nodes, selector=selector)
        answer = nodes.call(topics.START_GAME)
        assert not answer.success
        assert why in answer.message
        nodes.advance(1.0)
        assert nodes.value(topics.GAME_STATE) == "menu"
        nodes.stop(GAME)
    up(nodes, selector="original")
    topics.GAME_STATUS.publisher(nodes.observer)
    assert nodes.call(topics.START_GAME).success


def test_pellets_are_shown_once_a_second_and_taken_away(nodes: Session) -> None:
    nodes.record(topics.PELLET_MARKERS)
    up(nodes)
    nodes.clear()
    nodes.advance(3.0)
    rule = generate_pellets(load_map("house"), PelletConfig())
    shown = [pellets_of(message) for message in nodes.messages(topics.PELLET_MARKERS)]
    assert len(shown) == 3
    assert list(shown[0]) == rule.ids.tolist()
    for number, at in zip(rule.ids, rule.position, strict=True):
        assert shown[0][int(number)] == pytest.approx(tuple(at))
    for number in (3, 0, 3, 99, -1):
        nodes.publish(topics.REMOVE_PELLET, number)
    assert set(shown[0]) - set(pellets_of(nodes.last(topics.PELLET_MARKERS))) == {0, 3}
    assert nodes.call(topics.RESET_GAME).success
    assert pellets_of(nodes.last(topics.PELLET_MARKERS)) == shown[0]


def test_burst_of_commands_arrives_completely_fault_1(nodes: Session) -> None:
    up(nodes)
    for _ in range(4):  # disable, reset_round, return_home; disable, reset_round
        nodes.call(topics.START_GAME)
        nodes.call(topics.RESET_GAME)
    commands = ["disable", *["disable", "reset_round", "return_home", "disable", "reset_round"] * 4]
    assert nodes.values(topics.GAME_COMMAND) == commands
    late: list[str] = []
    nodes.subscribe(topics.GAME_COMMAND, lambda message: late.append(message.data))
    assert late == commands


def test_referee_stops_robot_before_it_leaves_fault_13(nodes: Session, state_folder: Path) -> None:
    up(nodes)
    running(nodes)
    assert list(state_folder.rglob("*.json"))
    nodes.stop(GAME)
    assert not list(state_folder.rglob("*.json"))  # the next one has nothing to go on with
    assert nodes.value(topics.GAME_STATE) == "menu"
    assert nodes.value(topics.GAME_COMMAND) == "disable"
    assert nodes.value(topics.GAME_EVENT) == "reset"


# A game that outlives its node


def again(nodes: Session) -> dict[str, Any]:
    """Start another referee; what it says at first."""
    nodes.clear()
    up(nodes)
    return {one.topic: one.value for one in nodes.on(*SAID)}


def test_killed_referee_continues_round(nodes: Session, state_folder: Path) -> None:
    up(nodes)
    running(nodes)
    status(nodes, "pellet_collected:1")
    assert nodes.value(topics.SCORE) == 1
    assert nodes.value(topics.GAME_EVENT) == "pellet"
    (kept,) = state_folder.rglob("*.json")
    assert kept.name.startswith("pacman_game-robot_15-")
    nodes.kill(GAME)
    assert again(nodes) == {
        "game_state": "running",
        "game_command": "enable",
        "game_result": "",
        "game/score": 1,
        "game/round": 1,
        "game/pellets_spawned": 13,
        "game/pellets_collected": 1,
        "clyde/speed": 0.25,
    }
    for pellet in (1, *range(13)):  # one once more: it counts once
        status(nodes, f"pellet_collected:{pellet}")
    assert nodes.value(topics.SCORE) == 13
    wait_state(nodes, "returning_home")
    status(nodes, "home_reached")
    wait_state(nodes, "menu")
    nodes.kill(GAME)  # between two rounds
    said = again(nodes)
    assert (said["game_state"], said["game_result"], said["game/round"]) == ("menu", "Complete - Score: 13", 2)
    assert nodes.call(topics.RESET_GAME).success
    assert not kept.exists()
    running(nodes)
    status(nodes, "death_detected")
    wait_state(nodes, "returning_home")
    status(nodes, "home_reached")
    nodes.kill(GAME)  # after the last round
    said = again(nodes)
    assert (said["game_state"], said["game_result"], said["game/round"]) == ("menu", "Death - Score: 0", 1)


def test_stop_survives_kill_until_release(nodes: Session, tmp_path: Path) -> None:
    """The stop is on the disk before it is confirmed; without a clock nothing is resumed, but the robot is stopped."""
    file = tmp_path / "game.json"
    nodes.record(topics.OPERATOR_STOP)
    up(nodes, state_file=file)
    running(nodes)
    request = {"stopped": True, "at": 1, "who": "a test", "by": "/test"}
    nodes.publish(topics.OPERATOR_STOP, json.dumps(request))
    assert json.loads(file.read_text())["state"]["stopped"] == "a test"
    file.unlink()
    nodes.advance(1.5)  # the file is written again each second: old files are not used
    nodes.kill(GAME)
    nodes.clear()
    nodes.clock_runs = False
    up_again = {"map_yaml": "house", "selector": "none", "settings": QUICK, "state_file": file}
    nodes.start(GAME, **up_again)
    stop = json.loads(nodes.value(topics.OPERATOR_STOP))
    assert (stop["stopped"], stop["who"]) == (True, "a test")
    assert not nodes.call(topics.START_GAME).success
    nodes.clock_runs = True
    nodes.advance(0.1)
    assert nodes.value(topics.GAME_STATE) == "running"
    request |= {"stopped": False, "at": stop["at"] + 10**10}
    nodes.publish(topics.OPERATOR_STOP, json.dumps(request))
    nodes.kill(GAME)
    nodes.clear()
    nodes.start(GAME, **up_again)
    nodes.advance(0.1)
    assert not json.loads(nodes.value(topics.OPERATOR_STOP))["stopped"]


@pytest.mark.parametrize("status", [CRASHED, STOOD_STILL])
def test_failed_game_is_saved_at_its_end(nodes: Session, tmp_path: Path, status: int) -> None:
    file = tmp_path / "game.json"
    up(nodes, state_file=file)
    running(nodes)
    file.unlink()  # its age after a standstill could be too high
    nodes.node(GAME).status = status
    nodes.drain()
    assert json.loads(file.read_text())["state"]["referee"]["state"] == "running"


def a_game(nodes: Session, domain: int, **changes: Any) -> dict[str, Any]:
    """A file's content, of a robot on its way home."""
    game = RoundController()
    game.lay_out([0, 1, 2])
    game.start(0.0)
    owner = {"namespace": "/robot_15", "domain": str(domain), "simulated": True}
    state = {"stopped": "", "referee": game.snapshot(0.0), "ghosts": [], "selector": {}}
    return {"format": 4, "written_s": time.time(), "owner": owner, "state": state} | changes


def test_file_is_complete_while_game_resumes(
    nodes: Session, tmp_path: Path, domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, saved = a_game(nodes, domain), []
    whole["state"]["selector"] = {"home": [1.0, 2.0, 0.0], "jump": "pose jumped", "round_s": 5.0}
    whole["state"]["selector"]["harmless_s"] = [[9.0, 0.0]] * len(GHOST_NAMES)
    (tmp_path / "game.json").write_text(json.dumps(whole))
    monkeypatch.setattr(StateFile, "save", lambda file, state: saved.append(state["selector"]))
    nodes.start(GAME, map_yaml="house", state_file=tmp_path / "game.json")
    nodes.advance(0.1)
    assert {(tuple(one["home"]), one["jump"]) for one in saved} == {((1.0, 2.0, 0.0), "pose jumped")}


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"owner": {"namespace": "/robot_7"}}, ""),
        ({"state": {"stopped": "", "referee": {"state": "running"}}}, "missing required field `score`"),
        ({"format": 1}, "another version"),
    ],
)
def test_old_or_invalid_game_is_not_continued(
    nodes: Session, tmp_path: Path, domain: int, log: Callable[[], str], change: dict[str, Any], complaint: str
) -> None:
    file = tmp_path / "game.json"
    text = json.dumps(a_game(nodes, domain, **change))
    file.write_text(text)
    up(nodes, state_file=file)
    assert nodes.value(topics.GAME_STATE) == "menu"
    assert complaint in log()
    if complaint == "another version":
        running(nodes)
        nodes.advance(5.0)
        assert file.read_text() == text
    else:
        nodes.advance(1.0)
        assert not file.exists()


def test_game_without_state_file_is_played(nodes: Session, tmp_path: Path, log: Callable[[], str]) -> None:
    up(nodes, state_file="")
    running(nodes)
    nodes.advance(5.0)
    assert not list(tmp_path.rglob("*.json"))
    nodes.stop(GAME)
    (tmp_path / "file").touch()
    up(nodes, state_file=tmp_path / "file" / "game.json")
    assert nodes.value(topics.GAME_STATE) == "menu"
    running(nodes)
    status(nodes, "pellet_collected:1")
    assert nodes.value(topics.SCORE) == 1
    assert log().count("a game is lost with this node") == 1
