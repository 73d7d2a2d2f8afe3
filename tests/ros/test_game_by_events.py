"""A round of all nodes over the simulated robot, in which the goal selector decides by events."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from eval.campaign.recorded_game import RecordedGame
from eval.campaign.robot_rounds import ONE_ROUND, play_round
from eval.campaign.schedule import part_of_map
from pacman_env.config import make_config


def test_a_round_is_completed_with_fewer_decisions_than_ticks(tmp_path: Path) -> None:
    ground = str(part_of_map("house", 3.0).save(tmp_path / "ground.yaml"))
    with RecordedGame(ground, 3, tmp_path, (*ONE_ROUND, "decisions.when=event")) as game:
        played = play_round(game, "clyde_aware", 0.1, 600.0)
        condition = game.recorder.condition
    assert played.end == "complete"
    assert played.collected > 2
    ticks = played.time_s / make_config().execution.tick_s
    assert played.collected < condition["decisions"]["count"] < 0.7 * ticks
    assert condition["goals_sent"] >= played.collected
