"""The referee: its services, what it says and in which order, and what changes nothing."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from pacman_env.game.round import RoundController
from pacman_env.ros import topics
from pacman_env.ros.game_nodes import REFEREE
from pacman_env.ros.message_conversion import markers_of
from tests.ros.session import Session

SAID = (
    *(topics.GAME_STATE, topics.GAME_COMMAND, topics.GAME_RESULT, topics.GAME_EVENT),
    *(topics.SCORE, topics.ROUND, topics.PELLETS_SPAWNED, topics.PELLETS_COLLECTED, topics.CLYDE_SPEED),
)
LATCHED = tuple(topic for topic in SAID if topic is not topics.GAME_EVENT)
CLOCK = "time_node"


@pytest.fixture(autouse=True)
def state_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where games are saved."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state"


def up(nodes: Session, *settings: str, **parameters: Any) -> None:
    quick = ["show.start_s=0.2", "show.death_s=0.2"]
    nodes.record(*SAID)
    nodes.announce(topics.GAME_STATUS)  # as a goal selector does
    nodes.start(REFEREE, **{"state_file": "auto", "settings": [*quick, *settings], **parameters})
    nodes.advance(0.1)
    assert all(nodes.values(topic) for topic in LATCHED)


def pellets(nodes: Session, ids: Sequence[int]) -> None:
    nodes.publish(topics.PELLET_MARKERS, markers_of({i: (float(i), 0.0) for i in ids}, nodes.stamp()))


def status(nodes: Session, word: str) -> None:
    nodes.publish(topics.GAME_STATUS, word)


def wait_state(nodes: Session, state: str) -> None:
    nodes.wait_for(lambda: nodes.values(topics.GAME_STATE)[-1:] == [state], 10.0, f"state {state}")


def running(nodes: Session, count: int = 3) -> None:
    """One round, begun; the pellets are known."""
    assert nodes.call(topics.START_GAME).success
    assert nodes.value(topics.GAME_STATE) == "returning_home"
    pellets(nodes, range(count))
    assert nodes.value(topics.PELLETS_SPAWNED) == count
    status(nodes, "home_reached")
    wait_state(nodes, "running")


def test_late_node_gets_all_latched_values(nodes: Session) -> None:
    nodes.start(REFEREE, settings=["clyde.speed_mps=0.3"])
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
        "game/pellets_spawned": 0,
        "game/pellets_collected": 0,
    }


def test_start_resets_others_and_is_refused_during_game(nodes: Session) -> None:
    called = nodes.serve(topics.RESET_PELLETS, topics.RESET_CLYDE)
    up(nodes)
    begun = nodes.call(topics.START_GAME)
    assert (begun.success, begun.message) == (True, "a round begins: the robot drives home first")
    assert sorted(called) == ["reset_clyde", "reset_pellets"]
    again = nodes.call(topics.START_GAME)
    assert not again.success
    assert "returning_home" in again.message
    back = nodes.call(topics.RESET_GAME)
    assert (back.success, back.message) == (True, "the game is reset: it is in the menu")
    assert nodes.value(topics.GAME_STATE) == "menu"


def test_start_is_refused_without_goal_selector(nodes: Session) -> None:
    nodes.record(*SAID)
    nodes.start(REFEREE)
    nodes.advance(0.1)
    answer = nodes.call(topics.START_GAME)
    why = "start: no goal selector yet; it starts when the robot has a pose"
    assert (answer.success, answer.message) == (False, why)
    nodes.advance(1.0)
    assert nodes.values(topics.GAME_STATE) == ["menu"]
    nodes.announce(topics.GAME_STATUS)
    nodes.advance(1.0)
    assert nodes.call(topics.START_GAME).success
    assert nodes.value(topics.GAME_STATE) == "returning_home"


def test_report_before_reset_is_not_of_new_round(nodes: Session) -> None:
    reports = topics.PELLET_MARKERS.publisher(nodes.observer)

    def put_back(request: Any, response: Any) -> Any:
        reports.publish(markers_of({4: (4.0, 0.0)}, nodes.stamp()))  # the referee has it before the answer
        response.success = True
        return response

    up(nodes)
    topics.RESET_PELLETS.server(nodes.observer, put_back)
    for service in (topics.START_GAME, topics.RESET_GAME, topics.START_GAME):
        assert nodes.call(service).success
        pellets(nodes, range(3))
        assert nodes.value(topics.PELLETS_SPAWNED) == 3
    assert set(nodes.values(topics.PELLETS_SPAWNED)) <= {0, 3}


def test_burst_of_commands_arrives_completely_fault_1(nodes: Session) -> None:
    up(nodes)
    for _ in range(4):  # disable, reset_round, return_home; disable, reset_round
        nodes.call(topics.START_GAME)
        nodes.call(topics.RESET_GAME)
    commands = ["disable", *["disable", "reset_round", "return_home", "disable", "reset_round"] * 4]
    assert nodes.values(topics.GAME_COMMAND) == commands
    late: list[str] = []
    nodes.game.subscribe(
        nodes.observer,
        lambda: topics.GAME_COMMAND.subscription(nodes.observer, lambda message: late.append(message.data)),
    )
    assert late == commands


def test_referee_stops_robot_before_it_leaves_fault_13(nodes: Session, state_folder: Path) -> None:
    up(nodes)
    running(nodes)
    assert list(state_folder.rglob("*.json"))
    nodes.stop(REFEREE)
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
    assert kept.name.startswith("robot_15-")
    nodes.kill(REFEREE)
    assert again(nodes) == {
        "game_state": "running",
        "game_command": "enable",
        "game_result": "",
        "game/score": 1,
        "game/round": 1,
        "game/pellets_spawned": 3,
        "game/pellets_collected": 1,
        "clyde/speed": 0.25,
    }
    for pellet in (1, 0, 2):  # the first once more: it counts once
        status(nodes, f"pellet_collected:{pellet}")
    assert nodes.value(topics.SCORE) == 3
    wait_state(nodes, "returning_home")
    status(nodes, "home_reached")
    wait_state(nodes, "menu")
    nodes.kill(REFEREE)  # between two rounds
    said = again(nodes)
    assert (said["game_state"], said["game_result"], said["game/round"]) == ("menu", "Complete - Score: 3", 2)
    assert nodes.call(topics.RESET_GAME).success
    assert not kept.exists()


def test_killed_referee_continues_streak_of_caught_ghosts(nodes: Session, state_folder: Path) -> None:
    nodes.record(topics.GHOSTS_CAUGHT)
    up(nodes, "power.pellets=1")
    assert nodes.call(topics.START_GAME).success
    nodes.publish(topics.PELLET_MARKERS, markers_of({0: (0.0, 0.0), 1: (1.0, 0.0)}, nodes.stamp(), power=[1]))
    status(nodes, "home_reached")
    wait_state(nodes, "running")
    status(nodes, "pellet_collected:1")
    status(nodes, "ghost_caught:1:inky")
    assert (nodes.value(topics.SCORE), nodes.value(topics.GAME_EVENT)) == (25, "inky caught")
    nodes.kill(REFEREE)
    nodes.clear()
    up(nodes, "power.pellets=1")
    assert (nodes.value(topics.SCORE), nodes.value(topics.GHOSTS_CAUGHT)) == (25, 1)
    status(nodes, "ghost_caught:1:inky")
    status(nodes, "ghost_caught:2:clyde")
    assert (nodes.value(topics.SCORE), nodes.value(topics.GHOSTS_CAUGHT)) == (65, 2)


def test_pellets_reported_before_clock_count(nodes: Session, tmp_path: Path, domain: int) -> None:
    file = tmp_path / "game.json"
    referee = RoundController()
    referee.start(0.0)
    for second in (1, 2):
        referee.pellets_left([0, 1, 2], second)
    referee.status("home_reached", 3.0)
    referee.tick(100.0)
    file.write_text(json.dumps(a_game(nodes, domain, state=referee.snapshot(100.0))))
    nodes.record(*SAID)
    clock = nodes.member(CLOCK)
    nodes.freeze(clock)  # there is no clock yet
    nodes.start(REFEREE, state_file=file)
    for pellet in (0, 1, 2):
        status(nodes, f"pellet_collected:{pellet}")
    assert not nodes.call(topics.START_GAME).success
    nodes.thaw(clock)
    nodes.advance(0.05)
    status(nodes, "game_complete")
    assert [text for text in nodes.values(topics.GAME_RESULT) if text] == ["Complete - Score: 3"]


def a_game(nodes: Session, domain: int, **changes: Any) -> dict[str, Any]:
    """A file's content, of a robot on its way home."""
    game = RoundController()
    game.start(0.0)
    game.pellets_left([0, 1, 2], 0.0)
    owner = {"namespace": "/robot_15", "domain": str(domain), "simulated": True}
    written_s = nodes.observer.surroundings.time_ns() * 1e-9
    return {"format": 3, "written_s": written_s, "owner": owner, "state": game.snapshot(0.0)} | changes


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"owner": {"namespace": "/robot_7"}}, ""),
        ({"state": {"state": "running"}}, "snapshot: Object missing required field `score`"),
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
    assert log().count("is left alone") == bool(complaint)
    assert complaint in log()
    if complaint:
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
    nodes.stop(REFEREE)
    (tmp_path / "file").touch()
    up(nodes, state_file=tmp_path / "file" / "game.json")
    assert nodes.value(topics.GAME_STATE) == "menu"
    running(nodes)
    status(nodes, "pellet_collected:1")
    assert nodes.value(topics.SCORE) == 1
    assert log().count("a game is lost with this node") == 1
