"""Kills in short series: of real processes, and in lock-step; what a series counts as a fault."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from pacman_env.ros.supervisor.game_nodes import GAME, REFEREE, SELECTOR, SIMULATOR
from tests.evaluation.helpers import refused_in_one_line
from tests.system import kills
from tests.system.kills import NODES, Kill, Watch, figures, missing


@pytest.fixture
def domain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A ROS_DOMAIN_ID that no other test process has."""
    pytest.importorskip("irobot_create_msgs")
    from tests.ros.system import free_domain

    for name in ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE"):
        monkeypatch.setenv(name, os.environ.get(name, ""))  # the command sets them
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "ros_log"))
    with free_domain() as number:
        yield number


@pytest.mark.daily
def test_the_game_goes_on_after_kills_of_real_processes(domain: int, tmp_path: Path) -> None:
    out = tmp_path / "kills.json"
    words = ["--kills", "2", "--speed", "4", "--domain-id", str(domain), "--logs", str(tmp_path), "--json", str(out)]
    assert kills.main(words) == 0
    found = json.loads(out.read_text())
    assert found["kills"] == 2
    assert found["status"] == 0
    assert found["back_s"] > 1.0  # `ros up` waits before it starts a node again


@pytest.mark.daily
def test_the_game_goes_on_in_lock_step_after_a_kill_of_each_node(domain: int, tmp_path: Path) -> None:
    out = tmp_path / "kills.json"
    assert kills.main(["--lock-step", "--kills", "8", "--logs", str(tmp_path), "--json", str(out)]) == 0
    found = json.loads(out.read_text())
    assert found["by_node"] == dict.fromkeys(NODES, 1)
    assert found["hangs"] == found["wrong"] == []
    assert set(NODES) == {SIMULATOR, SELECTOR, *GAME}


def test_a_node_that_receives_nothing_lacks_its_effects() -> None:
    watch = Watch()
    before = watch.counts.copy()
    assert missing(REFEREE, watch, before) == ["game/pellets_collected", "game_status"]
    watch.counts["game_status"] += 1
    assert missing(REFEREE, watch, before) == ["game/pellets_collected"]
    watch.counts["game/pellets_collected"] += 1
    assert missing(REFEREE, watch, before) == []
    watch.counts |= Counter({"pellet_markers": 1, "remove_pellet": 1})
    watch.shown, watch.removed = {1, 2}, {1}
    assert missing("pellet_manager", watch, before) == ["removed pellets are not shown"]


def test_a_score_that_is_not_that_of_the_pellets_is_a_fault() -> None:
    watch = Watch()
    watch.spawned = 13
    for result in ("", "Complete - Score: 13", "Complete - Score: 13", "Complete - Score: 26"):
        watch._end(result)
    assert (watch.rounds, watch.wrong) == (2, [])
    watch._end("Complete - Score: 38")
    assert watch.wrong == ["Complete - Score: 38, 26 before and 13 pellets"]
    watch._end("Death - Score: 40")
    watch._end("Complete - Score: 13")
    assert (watch.rounds, watch.deaths, len(watch.wrong)) == (4, 1, 1)


def test_figures_count_hangs_and_nodes() -> None:
    found = figures([Kill(REFEREE, "running", 3.0, 5.0), Kill(SELECTOR, "menu", 4.0, 90.0, ["game_status"])], Watch())
    assert found["by_node"] == {REFEREE: 1, SELECTOR: 1}
    assert found["on_s"]["longest"] == 90.0
    assert [one["node"] for one in found["hangs"]] == [SELECTOR]


@pytest.mark.parametrize("bad", [["--kills", "0"], ["--transport", "pigeon"], ["--minutes", "-1"]])
def test_bad_arguments_are_one_line(
    bad: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    refused_in_one_line(kills.main, bad, "python -m tests.system.kills", tmp_path, monkeypatch, capsys)
