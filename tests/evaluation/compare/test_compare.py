from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pacman_env import __version__
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.compare.__main__ import main
from pacman_env.evaluation.rounds.summary import SCHEMA
from pacman_env.world.maps.occupancy import load_map
from tests.evaluation.rounds.test_summary import PROMISED

ROOT = Path(__file__).resolve().parents[3]
SHORT = ["--episodes", "8", "--spacing", "3", "--time-limit", "120"]


def run(folder: Path, *arguments: str) -> dict[str, Any]:
    path = folder / "out.json"
    assert main([*SHORT, "--json", str(path), *arguments]) == 0
    result: dict[str, Any] = json.loads(path.read_text())
    return result


def without_times(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{k: v for k, v in row.items() if not k.startswith("decision")} for row in rows]


def test_json_has_every_row_and_setting(tmp_path: Path) -> None:
    result = run(tmp_path, "--clyde-speed", "0.25", "0.4", "--policies", "nearest", "random", "--seed", "7")
    rows = result["rows"]
    assert [(r["policy"], r["clyde_speed"]) for r in rows] == [
        ("nearest", 0.25),
        ("random", 0.25),
        ("nearest", 0.4),
        ("random", 0.4),
    ]
    for row in rows:
        assert set(row) >= PROMISED
        assert (row["map"], row["episodes"]) == ("house", 8)
        for name in ("completion", "all_but_one"):
            low, high = row[f"{name}_ci"]
            assert 0 <= low <= row[f"{name}_rate"] <= high <= 1
        assert row["completion_rate"] <= row["all_but_one_rate"]
        ends = ("completion_rate", "cleared_rate", "death_rate", "timeout_rate")
        assert sum(row[end] for end in ends) == pytest.approx(1)
        assert 0 <= row["pellets_mean"] <= row["pellets"]
        assert 0 < row["time_mean_s"] <= 120
        assert 0 < row["decision_ms_p50"] <= row["decision_ms_p99"]
        ends = row["outcomes"]["end"]
        assert [ends.count(letter) / 8 for letter in "CD"] == [row["completion_rate"], row["death_rate"]]
        assert np.mean(row["outcomes"]["collected"]) == row["pellets_mean"]
        low, high = row["paired_ci"]
        assert low <= row["paired_difference"] <= high
    assert rows[0]["paired_ci"] == [0.0, 0.0]
    assert rows[1]["paired_difference"] == pytest.approx(rows[1]["completion_rate"] - rows[0]["completion_rate"])
    assert (result["schema"], result["version"], result["seed"]) == (SCHEMA, __version__, 7)
    assert (result["preset"], result["execution"]) == ("robot", "robust")
    assert result["maps"] == [{"name": "house", "source": "house", "hash": load_map("house").hash}]
    assert result["policies"] == [{"name": name, "spec": name} for name in ("nearest", "random")]
    assert (result["kind"], rows[0]["kind"]) == ("compare", "round")
    assert result["seeds"] == [str(seed) for seed in episode_seeds(7, 8)]
    assert result["config"]["pellets"]["spacing_m"] == 3.0
    assert result["arguments"]["clyde_speed"] == [0.25, 0.4]


def test_workers_change_only_decision_times(tmp_path: Path) -> None:
    one = run(tmp_path)
    two = run(tmp_path, "--workers", "2")
    assert without_times(one["rows"]) == without_times(two["rows"])


def test_threads_change_only_decision_times(tmp_path: Path) -> None:
    policies = ["--policies", "lookahead", "nearest"]
    one = run(tmp_path, *policies)
    for more in (["--threads", "2"], ["--threads", "7"], ["--threads", "2", "--workers", "2"]):
        other = run(tmp_path, *policies, *more)
        assert without_times(one["rows"]) == without_times(other["rows"])
        assert one.keys() == other.keys()
        changed = {key for key in one if one[key] != other[key]} - {"rows"}
        assert changed <= {"arguments"}


def test_options_change_configuration_of_game(tmp_path: Path) -> None:
    options = ["--preset", "ideal", "--execution", "as_built", "--clyde-spawn", "anywhere"]
    options += ["--clyde-spawn-distance", "0", "--set", "nav2.abort_rate=1", "--policies", "nearest"]
    result = run(tmp_path, *options)
    config = result["config"]
    assert config["localization"]["perfect"] is True
    assert config["clyde"]["spawn"] == "anywhere"
    assert config["clyde"]["spawn_distance_m"] == 0.0
    assert config["time_limit_s"] == 120.0
    # every goal is aborted, and as built each abort loses the pellet
    assert result["rows"][0]["lost_mean"] > 0
    assert result["rows"][0]["aborts_mean"] >= result["rows"][0]["lost_mean"]


def test_repeated_policy_is_played_once(tmp_path: Path) -> None:
    rows = run(tmp_path, "--policies", "nearest", "nearest")["rows"]
    assert [row["policy"] for row in rows] == ["nearest"]


def test_plot_is_written_next_to_the_json(tmp_path: Path) -> None:
    run(tmp_path, "--policies", "nearest")
    assert (tmp_path / "out.png").is_file()
    run(tmp_path, "--policies", "nearest", "--plot", str(tmp_path / "sub" / "other.png"))
    assert (tmp_path / "sub" / "other.png").is_file()


def test_several_levels_count_as_one_map(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--levels", "test", "--num-levels", "2", "--policies", "clyde_aware", "nearest", "--time-limit", "20"]
    result = run(tmp_path, *options)
    (about,), rows = result["maps"], result["rows"]
    assert (about["name"], about["source"]) == ("generated:test", "--levels test")
    assert (about["start_level"], about["num_levels"]) == (1_000_000, 2)
    assert [(row["map"], row["policy"], row["levels"]) for row in rows] == [
        ("generated:test", "clyde_aware", 2),
        ("generated:test", "nearest", 2),
    ]
    assert rows[0]["outcomes"]["level"] == rows[1]["outcomes"]["level"]
    assert set(rows[0]["outcomes"]["level"]) == {1_000_000, 1_000_001}
    assert "pellets on 2 levels, Clyde at 0.25 m/s, 8 episodes" in capsys.readouterr().out


def test_endless_games_are_compared_by_pellets(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = run(tmp_path, "--endless", "--policies", "clyde_aware", "nearest", "--set", "clyde.ghosts=wander,chase")
    first, second = result["rows"]
    assert (first["kind"], second["kind"]) == ("endless", "endless")
    difference = second["pellets_mean"] - first["pellets_mean"]
    assert second["paired_difference"] == pytest.approx(difference)
    low, high = second["paired_ci"]
    assert low <= difference <= high
    assert "pellets per game" in capsys.readouterr().out
    assert (tmp_path / "out.png").is_file()


@pytest.mark.parametrize("ghosts", ["wander", "arcade", "chase", "wander,arcade,chase,wander"])
def test_ghosts_of_every_behaviour_can_be_set(tmp_path: Path, ghosts: str) -> None:
    result = run(tmp_path, "--policies", "nearest", "--set", f"clyde.ghosts={ghosts}")
    assert result["config"]["clyde"]["ghosts"] == ghosts.split(",")
    assert len(result["rows"][0]["outcomes"]["end"]) == 8


def test_json_lists_outcomes_on_one_line_each(tmp_path: Path) -> None:
    odd = tmp_path / "a [1,\n 2] b"
    odd.mkdir()
    result = run(odd, "--policies", "nearest")
    assert result["arguments"]["json"] == str(odd / "out.json")
    collected = result["rows"][0]["outcomes"]["collected"]
    assert f'"collected": {collected}' in (odd / "out.json").read_text()


def test_script_runs_from_checkout(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "eval/compare.py",
        *SHORT,
        "--map",
        "house",
        "--policies",
        "clyde_aware",
    ]
    command += ["nearest", "random", "--preset", "robot", "--execution", "as_built", "--clyde-speed", "0.25"]
    command += ["--seed", "1", "--json", str(tmp_path / "new" / "result.json")]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=True, env={**os.environ, "COLUMNS": "100"}
    )
    assert "house: " in done.stdout
    for policy in ("clyde_aware", "nearest", "random"):
        assert f"\n{policy} " in done.stdout
    assert "24/24" in done.stderr  # the progress bar
    assert {p.name for p in (tmp_path / "new").iterdir()} == {"result.json", "result.png", "result.parts"}
