"""How a game stands, for people and for programs: what is there, absent or not received, and what is not valid."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME, LISTENERS, module_of
from pacman_env.ros.observer import ObserverNode
from pacman_env.ros.supervisor.operator import status_json
from pacman_env.ros.supervisor.status_line import StatusLine
from tests.ros import session
from tests.ros.supervisor.test_operating import ask_plainly
from tests.ros.system import ROOT, Probe, System
from tests.waiting import PATIENCE_S


@pytest.fixture
def status_line(domain: int) -> Iterator[StatusLine]:
    with StatusLine("robot_15", sim=False) as node:
        yield node


def test_absent_and_pending_parts_are_named(domain: int, tmp_path: Path) -> None:
    with session.nodes(tmp_path, alone=False) as nodes, ObserverNode("audio_node", "/robot_15"):
        nodes.start(GAME, map_yaml="house", policy="nearest")
        answer = ask_plainly("status", "--json", "--wait", str(PATIENCE_S))
        rows = ask_plainly("status", "--wait", str(PATIENCE_S))
    assert answer.status == rows.status == 1
    facts: dict[str, Any] = json.loads(answer.out)
    assert facts["state"] == "menu"
    assert facts["nodes"] == [GAME]
    others = [name for name in LISTENERS if name != "audio_node"]
    assert facts["absent"] == {"nodes": others, "values": []}
    assert facts["pending"] == {"nodes": ["audio_node"], "values": []}
    assert facts["pose_age_s"] is None
    assert facts["stopped"] is False
    assert max(map(len, rows.out.splitlines())) <= 80
    lines = dict(line.split(None, 1) for line in rows.out.replace("\n" + 10 * " ", " ").splitlines())
    assert lines["absent"] == ", ".join(others)
    assert lines["pending"] == "audio_node"


def test_robot_page_lists_every_key_of_json(status_line: StatusLine) -> None:
    text = (ROOT / "docs" / "robot" / "simulation.md").read_text()
    rows = text.partition("| Key | Content |\n|---|---|\n")[2].partition("\n\n")[0].splitlines()
    named = {key for row in rows for key in re.findall(r"`(\w+)`", row.split("|")[1])}
    keys = json.loads(status_json(status_line, {"absent": {}, "pending": {}})).keys()
    assert named == keys | {"ghosts_caught"}  # with power pellets alone


def test_invalid_values_are_shown_as_unknown(probe: Probe, status_line: StatusLine) -> None:
    def say(state: str, collected: int) -> None:
        probe.publish(topics.GAME_STATE, state)
        probe.publish(topics.PELLETS_COLLECTED, collected)

    say("nonsense", -5)
    probe.publish(topics.PELLETS_SPAWNED, 13)
    probe.publish(topics.DIAGNOSTICS, '{"troubles": [3], "policy": "a\\nb"}')
    game = status_line.game
    assert status_line.spin_until(lambda: len(game.invalid) == 2 and game.condition, PATIENCE_S)
    assert status_line.spin_until(lambda: game.pellets_spawned, PATIENCE_S)
    assert status_line.line(pose_age=False).startswith("unknown state   round -  score -  pellets ?/13")
    facts = status_line.facts()
    assert facts["state"] is facts["pellets_collected"] is None
    assert facts["invalid"].keys() == {"state", "pellets_collected"}
    assert facts["policy"] == "a b"
    probe.publish(topics.GHOSTS_CAUGHT, 2)
    say("running", 5)
    assert status_line.spin_until(lambda: not game.invalid, PATIENCE_S)
    assert status_line.line(pose_age=False).startswith("running         round -  score -  pellets 5/13")
    assert status_line.spin_until(lambda: "ghosts caught 2" in status_line.line(pose_age=False), PATIENCE_S)


def test_status_line_shows_troubles(probe: Probe, status_line: StatusLine) -> None:
    condition = {"nav2": True, "troubles": {"stopped by the operator": 3, "off the map": 4, "ghosts unheard": 1}}
    probe.publish(topics.GAME_STATE, "running")
    probe.publish(topics.DIAGNOSTICS, json.dumps(condition))
    assert status_line.spin_until(lambda: status_line.game.condition and status_line.state, PATIENCE_S)
    assert status_line.line(pose_age=False).endswith("pellets -/-  off the map  no pose")


def test_silent_game_is_trouble(probe: Probe, status_line: StatusLine) -> None:
    probe.publish(topics.DIAGNOSTICS, '{"troubles": {}}')
    assert status_line.spin_until(lambda: status_line.silence is None, PATIENCE_S), "the message may be an old one"
    assert status_line.spin_until(lambda: status_line.silence, PATIENCE_S)
    assert f"{GAME} does not respond" in status_line.line(pose_age=False)
    assert status_line.facts()["silence"]
    probe.publish(topics.DIAGNOSTICS, '{"troubles": {}}')
    assert status_line.spin_until(lambda: status_line.silence == "", PATIENCE_S)


@pytest.mark.parametrize("state", ["running", "menu"])
def test_stop_names_driver_that_never_answers(system: System, probe: Probe, state: str) -> None:
    system.start(module_of("game_event_mapper"))
    probe.publisher(topics.GAME_STATE).publish(topics.GAME_STATE.type(data=state))
    answer = ask_plainly("stop", "--wait", str(PATIENCE_S))
    assert answer.status == (state == "running")
    assert (GAME in answer.out) == (state == "running")
