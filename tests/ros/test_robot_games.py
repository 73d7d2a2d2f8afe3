"""Three games of the campaign, with everything that it needs as real processes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from eval.robot_games import main
from eval.robot_schedule import GAMES_PER_SYSTEM, schedule
from pacman_env.ros.sim_faults import FAULTS


def test_games_with_faults_end_without_a_violation(domain: int, tmp_path: Path) -> None:
    seeds = SEEDS
    assert len({seed // GAMES_PER_SYSTEM for seed in seeds}) == 1  # one system
    planned = set().union(*(schedule(seed).kinds for seed in seeds))
    out = tmp_path / "games.json"
    status = main(["--only", *map(str, seeds), "--logs", str(tmp_path / "logs"), "--json", str(out)])
    games = json.loads(out.read_text())["games"]
    assert (status, [game["violations"] for game in games]) == (0, [[], [], []])
    assert [game["seed"] for game in games] == seeds
    happened = set().union(*(game["happened"] for game in games))
    assert happened <= planned
    assert len(happened & FAULTS.keys()) >= 2
    assert all(game["outcome"] != "never" for game in games)
