"""Some games of the campaign, with faults, frozen and killed nodes and lost packets."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from tests.system.campaign.__main__ import main
from tests.system.campaign.schedule import FREEZE, GAMES_PER_SYSTEM, KILL, LOSS, schedule

GAMES = [1870, 1871]  # in the first one a node is killed, one freezes, the network and the clock fail


def play(seeds: list[int], folder: Path) -> list[dict[str, Any]]:
    """The games of some seeds, none of which has a violation."""
    out = folder / "games.json"
    status = main(["--only", *map(str, seeds), "--logs", str(folder / "logs"), "--json", str(out)])
    games: list[dict[str, Any]] = json.loads(out.read_text())["games"]
    assert (status, [game["violations"] for game in games]) == (0, [[] for _ in seeds])
    assert [game["seed"] for game in games] == seeds
    assert not list((folder / "logs").iterdir())  # is kept after violations alone
    return games


@pytest.mark.daily
def test_games_with_all_kinds_of_outages_end_without_a_violation_and_are_the_same_when_one_is_repeated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert GAMES[0] % GAMES_PER_SYSTEM == 0
    planned = set().union(*(schedule(seed).kinds for seed in GAMES))
    games = play(GAMES, tmp_path)
    rows = capsys.readouterr().out.splitlines()
    happened = set().union(*(game["happened"] for game in games))
    assert {FREEZE, KILL, LOSS, "reject", "abort", "clock_jump"} <= happened <= planned
    assert all(game["outcome"] in ("complete", "lost", "reset") for game in games)
    assert all(game["messages"] > 100 * game["simulated_s"] > 0.0 for game in games)
    assert len({game["transcript"] for game in games}) == len(GAMES)
    table = {line[:34].strip(): line[34:].split() for line in rows}
    assert table["all games"][0] == str(len(GAMES))
    assert table["freeze"][0] == str(sum(FREEZE in game["happened"] for game in games))
    assert [line.split()[0] for line in rows[1 : 1 + len(GAMES)]] == list(map(str, GAMES))
    assert play(GAMES[1:2], tmp_path) == games[1:2]
