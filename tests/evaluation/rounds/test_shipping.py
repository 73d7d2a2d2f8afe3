"""Rounds on other machines, which have none of the files that a matchup names."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.compare.__main__ import main
from pacman_env.evaluation.rounds.play import Matchup, play_all
from pacman_env.evaluation.rounds.shipping import pack, play_packed
from pacman_env.executors.base import InProcess
from pacman_env.policies.learned import PRETRAINED
from pacman_env.world.maps.occupancy import load_map
from tests.evaluation.helpers import LEVELS, LEVELS_CONFIG


@pytest.fixture
def matchups(tmp_path: Path) -> list[Matchup]:
    load_map("loop").save(tmp_path / "mine.yaml")
    for path, name in ((PRETRAINED, "own"), (PRETRAINED.with_name("clyde.onnx"), "ghost")):
        for suffix in (".onnx", ".json"):
            shutil.copy(path.with_suffix(suffix), tmp_path / f"{name}{suffix}")
    config = make_config("robot", **{"clyde.ghosts": ("wander", str(tmp_path / "ghost.onnx"))})
    seeds = episode_seeds(3, 6)
    return [
        Matchup(str(tmp_path / "mine.yaml"), config, str(tmp_path / "own.onnx"), seeds),
        Matchup(LEVELS, LEVELS_CONFIG, "nearest", seeds),
    ]


def test_packed_matchup_is_played_without_original_files(
    matchups: list[Matchup], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PACMAN_ENV_CACHE", str(tmp_path / "cache"))
    expected = [records for records, _ in play_all(matchups, InProcess())]
    tasks = [pack(matchup) for matchup in matchups]
    for path in tmp_path.glob("*.*"):
        path.unlink()
    for task, records in zip(tasks, expected, strict=True):
        np.testing.assert_array_equal(play_packed(task)[0], records)
    kept = sorted(path.name for path in (tmp_path / "cache" / "sent").glob("*/*"))
    assert kept == ["ghost.json", "ghost.onnx", "own.json", "own.onnx"]


@pytest.mark.daily
def test_damaged_copy_is_replaced(matchups: list[Matchup], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PACMAN_ENV_CACHE", str(tmp_path / "cache"))
    records = play_packed(pack(matchups[0]))[0]
    for path in (tmp_path / "cache" / "sent").glob("*/own.onnx"):
        path.write_bytes(b"half")
    np.testing.assert_array_equal(play_packed(pack(matchups[0]))[0], records)


def test_absent_file_is_named_before_packing(matchups: list[Matchup], tmp_path: Path) -> None:
    (tmp_path / "own.onnx").unlink()
    with pytest.raises(FileNotFoundError, match=r"own\.onnx"):
        pack(matchups[0])


def without_times(path: Path) -> dict:
    content = json.loads(path.read_text())
    for row in content["rows"]:
        for name in [name for name in row if name.startswith("decision")]:
            del row[name]
    del content["arguments"]["json"]
    return content


def test_comparison_on_ray_equals_comparison_in_process(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    found = []
    for name, more in (("one", []), ("ray", ["--ray", "--workers", "2"])):
        path = tmp_path / f"{name}.json"
        words = ["--map", "loop", "--policies", "clyde_aware", str(PRETRAINED), "--episodes", "8", "--json", str(path)]
        assert main([*words, *more]) == 0
        found.append(without_times(path))
    assert found[0] == found[1]
