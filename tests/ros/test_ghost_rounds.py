"""Rounds of the nodes against several ghosts, a learned one and one of a plug-in among them."""

import itertools
import math
from pathlib import Path

import pytest

from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.ros import topics
from pacman_env.ros.message_conversion import pose_of
from tests.map_parts import part_of_map
from tests.plugin_example import install
from tests.ros import session


def play_round(folder: Path, ghosts: str, policy: str, preset: str = "robot") -> None:
    """Play one round; every ghost moves, and one of them alone may end it."""
    poses = topics.GHOST_POSES[: len(ghosts.split(","))]
    ground = part_of_map("house", 3.0).save(folder / "ground.yaml")
    settings = (f"clyde.ghosts={ghosts}", "clyde.speed_mps=0.3")
    with session.game(folder, ground, policy, seed=3, settings=settings, preset=preset) as played:
        played.record(topics.GAME_STATE, topics.GAME_EVENT, topics.GAME_STATUS, topics.PELLETS_COLLECTED, *poses)
        assert played.call(topics.START_GAME).success
        played.wait_for(lambda: "running" in played.values(topics.GAME_STATE), 60.0)
        played.wait_for(lambda: played.values(topics.GAME_STATE)[-1] != "running", 600.0)
        reports = played.values(topics.GAME_STATUS)
        assert played.values(topics.PELLETS_COLLECTED)[-1] == sum(one.startswith("pellet_coll") for one in reports)
        killers = {f"{name} killed" for name in GHOST_NAMES[: len(poses)]} & set(played.values(topics.GAME_EVENT))
        assert len(killers) == (played.values(topics.GAME_STATE)[-1] == "dying")
        for topic in poses:
            places = [pose_of(message)[:2] for message in played.messages(topic)]
            assert max(math.dist(*pair) for pair in itertools.pairwise(places)) > 0.01
        assert played.errors() == []


def test_round_against_three_behaviours_ends(domain: int, tmp_path: Path) -> None:
    play_round(tmp_path, "arcade,chase,wander", "clyde_aware")


def test_round_with_power_pellets_counts_pellets_and_caught_ghosts(domain: int, tmp_path: Path) -> None:
    ground = part_of_map("house", 3.0).save(tmp_path / "ground.yaml")
    approaching = ("power.pellets=9", "power.duration_s=60", "power.behaviour=chase", "power.speed_factor=1")
    settings = ("clyde.ghosts=wander,wander", "clyde.spawn_distance_m=2", "show.start_s=1", *approaching)
    with session.game(tmp_path, ground, "nearest", seed=2, preset="robot_0_15", settings=settings) as played:
        played.record(topics.GAME_STATE, topics.GAME_RESULT, topics.GAME_EVENT, topics.GHOSTS_CAUGHT)
        assert played.call(topics.START_GAME).success
        played.wait_for(lambda: "complete" in played.values(topics.GAME_STATE), 600.0, "a complete round")
        events = [event for event in played.values(topics.GAME_EVENT) if event not in ("start theatrical", "reset")]
        points = streak = 0
        for event in events:
            points += {"pellet": 1, "power pellet": 5}.get(event, 0)
            if event.endswith(" caught"):
                points += 20 * 2 ** min(streak, 3)
            streak = streak + 1 if event.endswith(" caught") else 0 if event == "power pellet" else streak
        caught = sum(event.endswith(" caught") for event in events)
        assert caught > 0
        assert max(played.values(topics.GHOSTS_CAUGHT)) == caught
        assert f"Complete - Score: {points}" in played.values(topics.GAME_RESULT)
        assert played.errors() == []


@pytest.mark.daily
def test_round_against_learned_and_plugin_ghost_ends(
    domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch")
    pytest.importorskip("onnxruntime")
    from tests.training.planners import random_planner

    site = str(install(tmp_path))
    monkeypatch.syspath_prepend(site)
    monkeypatch.setenv("PYTHONPATH", site)
    play_round(tmp_path, f"{random_planner(tmp_path)},ambush", "shy", preset="sleepy")
