"""Rounds on other machines, which have none of the files that a matchup names."""

from pathlib import Path

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.rounds.play import Matchup, play_all
from pacman_env.evaluation.rounds.shipping import hash_of_files, pack, play_packed
from pacman_env.executors.base import InProcess
from pacman_env.policies.learned import PRETRAINED
from tests.evaluation.helpers import LEVELS, LEVELS_CONFIG, comparison, copy_planners


@pytest.fixture
def matchups(tmp_path: Path) -> list[Matchup]:
    planner, ghost = copy_planners(tmp_path)
    config = make_config("robot", **{"clyde.ghosts": ("wander", ghost)})
    seeds = episode_seeds(3, 6)
    return [
        Matchup(str(tmp_path / "mine.yaml"), config, planner, seeds),
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


def test_hash_of_files_depends_on_content_only(tmp_path: Path) -> None:
    hashes = []
    for suffix in (".zip", ".facts.json"):
        for name in ("run", "same"):
            (tmp_path / f"{name}{suffix}").write_text(suffix)
        hashes.append(hash_of_files(tmp_path / "run.zip"))
    assert len(set(hashes)) == 2


def test_comparison_on_ray_equals_comparison_in_process(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    policies = ["--map", "loop", "--policies", "clyde_aware", str(PRETRAINED)]
    one = comparison(tmp_path / "one.json", *policies)
    assert comparison(tmp_path / "ray.json", *policies, "--ray", "--workers", "2") == one
