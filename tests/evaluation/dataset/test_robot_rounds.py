"""Rounds of a robot as a data set: what is in them is what was recorded."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")
pytest.importorskip("rosbags")
pytest.importorskip("pandas")
pytest.importorskip("minari")

import minari
import pandas

from pacman_env.evaluation.dataset.__main__ import main
from pacman_env.ros import topics
from tests.ros.bags.recorded import record_round, without

NAME_OF_IT = "pacman-env/robot-v0"


@pytest.fixture(scope="module")
def recorded(domain: int, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The bag of one round that was played by the nodes, and its map."""
    bag = record_round(tmp_path_factory.mktemp("robot"), "nearest", "power.pellets=1", "reward.power=0.5")
    return bag, str(bag.parent / "ground.yaml")


def written(folder: Path, bag: Path, ground: str, *more: str) -> Path:
    assert main([NAME_OF_IT, "--bags", str(bag), "--map", ground, "--root", str(folder), *more]) == 0
    return folder / NAME_OF_IT


def test_round_of_robot_nodes_becomes_one_episode(
    recorded: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = written(tmp_path, *recorded)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    data = minari.load_dataset(NAME_OF_IT)
    assert data.total_episodes == 1
    episode = data[0]
    assert data.observation_space.contains(episode.observations[0])
    assert len(episode.observations) == len(episode.actions) + 1
    decisions, rounds = (pandas.read_parquet(folder / f"{name}.parquet") for name in ("decisions", "rounds"))
    (about,) = rounds.to_dict("records")
    assert (about["outcome"], about["collected"], about["spawned"], about["unlisted"]) == ("complete", 3, 3, 0)
    config = json.loads((folder / "facts.json").read_text())["settings"]
    assert config["execution.tick_s"] == 0.1  # the game's own
    ticks = decisions["elapsed_s"].sum() / 0.1
    assert about["return"] == pytest.approx(3 * 1.0 + 0.5 + 5.0 - 0.002 * ticks)
    assert (decisions["reward"] > 0.9).sum() == 3
    assert decisions["terminated"].tolist() == [False] * (len(decisions) - 1) + [True]
    allowed = np.stack(decisions["action_mask"].to_list())
    assert allowed[np.arange(len(decisions)), decisions["action"]].all()
    assert (decisions["action"] == 0).mean() > 0.8  # listed by their distance: the policy takes the nearest
    card = (folder / "README.md").read_text()
    assert "played by a robot" in card
    assert "To replay a round" not in card
    assert "['game']" in card


def test_recorded_round_yields_other_observation_kinds(recorded: tuple[Path, str], tmp_path: Path) -> None:
    kinds = ["--id", "PacManBot-v1", "--observation", "features", "planner"]
    folder = written(tmp_path, *recorded, "--format", "parquet", *kinds)
    keys = {"observation.robot", "observation.candidates", "observation.planner_globals"}
    assert keys <= set(pandas.read_parquet(folder / "decisions.parquet").columns)


def test_interrupted_round_is_truncated(domain: int, tmp_path: Path) -> None:
    bag = record_round(tmp_path, "nearest", breaks_off=True)
    folder = written(tmp_path, bag, str(tmp_path / "ground.yaml"), "--format", "parquet")
    decisions, rounds = (pandas.read_parquet(folder / f"{name}.parquet") for name in ("decisions", "rounds"))
    assert rounds["outcome"].tolist() == ["running"]
    assert rounds["collected"].tolist() == [1]
    assert len(decisions) > 20
    assert decisions["truncated"].sum() == decisions["truncated"].iloc[-1] == 1
    assert decisions["elapsed_s"].iloc[:-1].to_numpy() == pytest.approx(0.1)


def test_unsuitable_rounds_are_refused(
    recorded: tuple[Path, str], tmp_path: Path, refused: Callable[[Any, list[str], str], None]
) -> None:
    bag, ground = recorded
    without(bag, tmp_path / "foreign", topics.SCORES)
    scan = ["--id", "PacManBot-v1", "--observation", "scan"]
    only = "rounds of a robot provide only features, planner, power, bearings"
    for words, message in (
        (["--map", ground, "--bags", str(tmp_path / "foreign")], "the choices of its goal selector"),
        (["--map", ground, "--bags", str(tmp_path / "none")], "not a readable bag"),
        (["--map", ground, "--bags", str(bag), *scan], only),
        (["--map", "maze", "--bags", str(bag)], "no round with a decision"),
    ):
        refused(main, [NAME_OF_IT, "--root", str(tmp_path / "out"), *words], message)
