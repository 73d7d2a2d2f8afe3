"""Rounds over the simulated robot from start to end, against any ghosts, and their command."""

from __future__ import annotations

import itertools
import json
import math
from functools import partial
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.ros import topics
from pacman_env.ros.messages import pose_of
from tests.plugin_example import install
from tests.system.campaign import robot_rounds
from tests.system.campaign.recorded_game import RecordedGame
from tests.system.campaign.robot_rounds import ONE_ROUND, main, play_round
from tests.system.campaign.schedule import part_of_map
from tests.system.campaign.workers import errors, logged


@pytest.fixture
def ground(tmp_path: Path) -> str:
    """Some rooms of the house."""
    return str(part_of_map("house", 3.0).save(tmp_path / "ground.yaml"))


def play(ground: str, folder: Path, ghosts: str, policy: str, preset: str = "robot") -> None:
    """A round against these ghosts, which all are seen to move and of whom anyone may end it."""
    count = len(ghosts.split(","))
    settings = (*ONE_ROUND, f"clyde.ghosts={ghosts}")
    folder.mkdir()
    with logged(folder / "nodes.log"), RecordedGame(ground, 3, folder, settings, preset) as game:
        recorder = game.recorder
        places: list[list[tuple[float, float]]] = [[] for _ in range(count)]

        def take(k: int, message: Any) -> None:
            if recorder.state == "running":
                places[k].append(pose_of(message)[:2])

        for k, topic in enumerate(topics.GHOST_POSES[:count]):
            game.subscribe(recorder, partial(topic.subscription, recorder, partial(take, k)))
        played = play_round(game, policy, 0.3, 600.0)
        events = [r.value for r in recorder.records if r.topic == topics.GAME_EVENT.name]
        statuses = [r.value for r in recorder.records if r.topic == topics.GAME_STATUS.name]
    assert errors((folder / "nodes.log").read_text()) == []
    assert played.end in ("complete", "dead")
    assert played.collected == sum(status.startswith("pellet_collected") for status in statuses)
    killers = {f"{name} killed" for name in GHOST_NAMES[:count]}
    assert len(killers & set(events)) == (played.end == "dead")
    for path in places:
        steps = [math.dist(a, b) for a, b in itertools.pairwise(path)]
        assert max(steps) > 0.01


def test_a_round_against_three_ghosts_of_the_table(ground: str, tmp_path: Path) -> None:
    play(ground, tmp_path / "logs", "arcade,chase,wander", "clyde_aware")


@pytest.mark.daily
def test_a_round_against_a_learned_ghost_and_one_of_a_plug_in_by_its_preset_and_policy(
    ground: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch")
    pytest.importorskip("onnxruntime")
    from tests.training.planners import random_planner

    site = str(install(tmp_path))
    monkeypatch.syspath_prepend(site)
    monkeypatch.setenv("PYTHONPATH", site)
    play(ground, tmp_path / "logs", f"{random_planner(tmp_path)},ambush", "shy", preset="sleepy")


@pytest.mark.daily
def test_the_command_sets_both_sides_beside_one_another_and_plays_the_same_rounds_in_any_number_of_jobs(
    ground: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_rounds, "ROUNDS_TOGETHER", 1)

    def figures(jobs: int) -> Any:
        out = tmp_path / f"{jobs}.json"
        scale = ["--rounds", "2", "--episodes", "20", "--jobs", str(jobs), "--json", str(out)]
        assert main(["--map", ground, "--policies", "clyde_aware", "--clyde-speed", "0.25", *scale]) == 0
        return json.loads(out.read_text())

    found = figures(1)
    assert figures(2) == found
    (row,) = found["rows"]
    assert row["robot_rounds"] + row["robot_not_started"] == len(found["rounds"]) == 2
    assert found["rounds"][0] != found["rounds"][1]
    ends = [one["end"] for one in found["rounds"]]
    assert row["robot_complete"] == ends.count("complete") / 2
    assert row["inside"] == (row["simulator_interval"][0] <= row["robot_complete"] <= row["simulator_interval"][1])
    assert all(one["collected"] > 0 for one in found["rounds"] if one["end"] == "complete")
