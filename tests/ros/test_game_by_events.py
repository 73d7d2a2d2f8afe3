"""A round of all nodes over the simulated robot, in which the goal selector decides by events."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from pacman_env.config import make_config
from pacman_env.ros import topics
from tests.map_parts import part_of_map
from tests.ros import session

SETTINGS = ("decisions.when=event", "clyde.speed_mps=0.1", "show.start_s=1.0")


def test_round_by_events_needs_fewer_decisions(domain: int, tmp_path: Path) -> None:
    ground = part_of_map("house", 3.0).save(tmp_path / "ground.yaml")
    with session.game(tmp_path, ground, seed=3, settings=SETTINGS) as game:
        game.record(
            topics.GAME_STATE, topics.GAME_RESULT, topics.PELLETS_COLLECTED, topics.PELLETS_SPAWNED, topics.DIAGNOSTICS
        )
        assert game.call(topics.START_GAME).success
        game.wait_for(lambda: game.values(topics.GAME_STATE)[-1] == "running", 30.0, "the round")
        began_s, spawned = game.now_s, game.values(topics.PELLETS_SPAWNED)[-1]
        game.wait_for(lambda: game.values(topics.GAME_STATE)[-1] != "running", 600.0, "its end")
        ticks = (game.now_s - began_s) / make_config().execution.tick_s
        collected = max(game.values(topics.PELLETS_COLLECTED))
        game.forget(topics.DIAGNOSTICS)
        condition = json.loads(
            game.wait_for(lambda: game.values(topics.DIAGNOSTICS), 10.0, "the planner's diagnostics")[-1]
        )
        assert game.errors() == []
        assert "Complete" in game.values(topics.GAME_RESULT)[-1]
    assert collected == spawned > 2
    assert collected < condition["decisions"]["count"] < 0.7 * ticks
    assert condition["goals_sent"] >= collected
