"""A game that was played and recorded in lock-step: its replay finds every choice again."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")
pytest.importorskip("rosbags")

from pacman_env.ros import topics
from pacman_env.ros.bags.bag_replay import replay_bag
from pacman_env.ros.bags.record import NAME, Recorder
from tests.map_parts import part_of_map
from tests.ros import session


@pytest.mark.parametrize("policy", ["nearest", "clyde_aware"])
def test_every_choice_of_a_recorded_round_is_found_again(domain: int, tmp_path: Path, policy: str) -> None:
    ground = part_of_map("loop", 3.0).save(tmp_path / "ground.yaml")
    often = ("execution.tick_s=0.1", "execution.check_period_s=0.1")  # many decisions in a short round
    settings = ("show.start_s=1.0", "clyde.speed_mps=0.02", *often)
    with session.game(tmp_path, ground, policy, seed=1, settings=settings) as game:
        recorder = game.start(NAME, lambda: Recorder(tmp_path / "game", sim_time=True))
        game.record(topics.GAME_STATE, topics.GAME_RESULT)
        assert game.call(topics.START_GAME).success
        game.wait_for(lambda: game.last(topics.GAME_RESULT).data, 600, "the end of the round")
        result = game.last(topics.GAME_RESULT).data
        game.game.remove(recorder)
    report = replay_bag(tmp_path / "game", str(ground), policy)
    assert (report.rounds, report.bad_messages, result) == (1, {}, "Complete - Score: 3")
    assert report.statuses["pellet_collected"] == 3
    assert (report.same, report.unknown, report.otherwise) == (report.decisions, 0, [])
    assert report.decisions > 100
