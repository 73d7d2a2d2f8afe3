import json
from pathlib import Path

import pytest

from pacman_env import __version__
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.rounds.summary import SCHEMA
from pacman_env.world.maps.occupancy import load_map
from tests.evaluation.helpers import comparison
from tests.evaluation.rounds.test_summary import PROMISED


def test_json_has_every_row_and_setting(tmp_path: Path) -> None:
    path = tmp_path / "a [1,\n 2] b" / "out.json"
    policies = ["--policies", "nearest", "random_pellet", "nearest"]
    comparison(path, "--clyde-speed", "0.25", "0.4", *policies, "--seed", "7", "--plot", str(tmp_path / "p.png"))
    result = json.loads(path.read_text())
    rows = result["rows"]
    played = [("nearest", 0.25), ("random_pellet", 0.25), ("nearest", 0.4), ("random_pellet", 0.4)]
    assert [(row["policy"], row["clyde_speed"]) for row in rows] == played
    for row in rows:
        assert set(row) >= PROMISED
        assert (row["map"], row["episodes"], row["kind"]) == ("house", 8, "round")
        assert row["outcomes"]["end"].count("C") / 8 == row["completion_rate"]
        assert 0 < row["decision_ms_p50"] <= row["decision_ms_p99"]
        low, high = row["paired_ci"]
        assert low <= row["paired_difference"] <= high
    assert rows[0]["paired_ci"] == [0.0, 0.0]
    assert rows[1]["paired_difference"] == pytest.approx(rows[1]["completion_rate"] - rows[0]["completion_rate"])
    assert (result["schema"], result["version"], result["seed"]) == (SCHEMA, __version__, 7)
    assert (result["kind"], result["preset"], result["execution"]) == ("compare", "robot", "robust")
    assert result["maps"] == [{"name": "house", "source": "house", "hash": load_map("house").hash}]
    assert result["policies"] == [{"name": name, "spec": name} for name in ("nearest", "random_pellet")]
    assert result["seeds"] == [str(seed) for seed in episode_seeds(7, 8)]
    assert result["config"]["pellets"]["spacing_m"] == 3.0
    assert result["arguments"]["clyde_speed"] == [0.25, 0.4]
    assert result["arguments"]["json"] == str(path)
    assert f'"collected": {rows[0]["outcomes"]["collected"]}' in path.read_text()  # on one line
    assert (tmp_path / "p.png").is_file()


def test_options_change_configuration_of_game(tmp_path: Path) -> None:
    options = ["--preset", "ideal", "--execution", "as_built", "--clyde-spawn", "anywhere"]
    options += ["--clyde-spawn-distance", "0", "--set", "nav2.abort_rate=1", "--policies", "nearest"]
    result = comparison(tmp_path / "out.json", *options)
    config = result["config"]
    assert config["localization"]["perfect"] is True
    assert (config["clyde"]["spawn"], config["clyde"]["spawn_distance_m"]) == ("anywhere", 0.0)
    assert config["time_limit_s"] == 120.0
    # every goal is aborted, and as built each abort loses the pellet
    assert result["rows"][0]["aborts_mean"] >= result["rows"][0]["lost_mean"] > 0
