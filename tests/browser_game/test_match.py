"""The game of the page without a server, in Node."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

_PROGRAM = Path(__file__).with_name("match.mjs")


@pytest.fixture(scope="module")
def match(browser_game: Path) -> dict[str, Any]:
    command = ["node", str(_PROGRAM), str(browser_game / "game")]
    result: dict[str, Any] = json.loads(subprocess.run(command, check=True, capture_output=True, timeout=120).stdout)
    return result


def test_first_round_is_shown_before_loading(match: dict[str, Any]) -> None:
    assert match["kinds"] == ["hello", "people", "scene"]
    assert match["first"] == "menu"
    assert match["demo"] > 100


def test_link_repeats_round_of_person(match: dict[str, Any]) -> None:
    played = match["played"]
    assert played["player"] == "person"
    assert played["result"] in ("complete", "caught")
    assert len(played["moves"]["orders"]) > 5
    assert match["same"]
    assert match["until"] == 12


def test_ghost_of_person_follows_robot(match: dict[str, Any]) -> None:
    assert match["ghost"]["ghosts_played"] == [1]
    assert match["ghost"]["moves"]["orders"] == [[0, {"ghosts": {"1": -1}}]]
    assert match["ghostSame"]


def test_impossible_requests_are_refused(match: dict[str, Any]) -> None:
    assert all(match["refusals"])
    assert "generated-3" in match["refusals"][1]
    assert match["unchanged"]


def test_terms_explain_choice_of_policy(match: dict[str, Any]) -> None:
    why = match["why"]
    best = max(why["rows"], key=lambda row: row["terms"]["ppo"]["score"])
    assert best["candidate"] == why["chosen"]["ppo"]
    assert sum(row["terms"]["ppo"]["probability"] for row in why["rows"]) == pytest.approx(1, abs=1e-3)
    assert match["explained"] > 10


def test_stopped_game_stands_still(match: dict[str, Any]) -> None:
    assert match["stopped"] == 0
    assert {"start", "pellet", "running", "menu"} <= set(match["events"])
    assert match["numbers"]


def test_demo_leaves_prepared_round_unharmed(match: dict[str, Any]) -> None:
    assert list(match["placed"]) == ["1"]
    assert match["otherDemo"] > 100
