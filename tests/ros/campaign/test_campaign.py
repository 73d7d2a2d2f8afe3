"""Some games of the campaign, with everything that it needs as real processes."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from eval.campaign import network
from eval.campaign.__main__ import main
from eval.campaign.games import NETWORK
from eval.campaign.schedule import FREEZE, GAMES_PER_SYSTEM, KILL, LOSS, schedule
from pacman_env.ros.simulated_robot.sim_faults import FAULTS

WITH_FAULTS = [324, 325]  # goals are rejected, Nav2 goes away, the clock jumps, the goal selector is frozen
WITH_LOSSES = [13, 14]  # 60 % of the pellet manager's packets are lost, the light node is killed


def play(seeds: list[int], folder: Path, *arguments: str) -> list[dict[str, Any]]:
    """The games of one system, none of which has a violation."""
    assert len({seed // GAMES_PER_SYSTEM for seed in seeds}) == 1
    out = folder / "games.json"
    status = main(["--only", *map(str, seeds), "--logs", str(folder / "logs"), "--json", str(out), *arguments])
    games: list[dict[str, Any]] = json.loads(out.read_text())["games"]
    assert (status, [game["violations"] for game in games]) == (0, [[] for _ in seeds])
    assert [game["seed"] for game in games] == seeds
    assert all(game["outcome"] in ("complete", "lost", "reset") for game in games)  # which of them is a matter of time
    return games


def test_games_with_faults_and_a_frozen_node_end_without_a_violation(domain: int, tmp_path: Path) -> None:
    planned = set().union(*(schedule(seed).kinds for seed in WITH_FAULTS))
    games = play(WITH_FAULTS, tmp_path, "--without", NETWORK)
    happened = set().union(*(game["happened"] for game in games))
    assert happened <= planned - {LOSS}
    assert {"reject", "nav2_away", "clock_jump"} <= happened & FAULTS.keys()
    assert FREEZE in happened


def test_games_with_lost_packets_and_a_killed_node_end_without_a_violation(domain: int, tmp_path: Path) -> None:
    if (reason := network.why_not()) and not os.environ.get("CI"):
        pytest.skip(f"no network with losses: {reason}")
    games = play(WITH_LOSSES, tmp_path)
    assert {KILL, LOSS} <= set().union(*(game["happened"] for game in games))
