"""Two games of the campaign, with everything that it needs as real processes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from eval.campaign.__main__ import main
from eval.campaign.schedule import GAMES_PER_SYSTEM, schedule
from pacman_env.ros.simulated_robot.sim_faults import FAULTS

SEEDS = [324, 325]  # goals are rejected, Nav2 goes away and the clock jumps


def test_games_with_faults_end_without_a_violation(domain: int, tmp_path: Path) -> None:
    assert len({seed // GAMES_PER_SYSTEM for seed in SEEDS}) == 1  # one system
    planned = set().union(*(schedule(seed).kinds for seed in SEEDS))
    out = tmp_path / "games.json"
    status = main(["--only", *map(str, SEEDS), "--logs", str(tmp_path / "logs"), "--json", str(out)])
    games = json.loads(out.read_text())["games"]
    assert (status, [game["violations"] for game in games]) == (0, [[], []])
    assert [game["seed"] for game in games] == SEEDS
    happened = set().union(*(game["happened"] for game in games))
    assert happened <= planned
    assert {"reject", "nav2_away", "clock_jump"} <= happened & FAULTS.keys()
    assert all(game["outcome"] in ("complete", "lost", "reset") for game in games)  # which of them is a matter of time
