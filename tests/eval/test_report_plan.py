from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from eval.episodes import episode_seeds
from eval.report_plan import ENDLESS_GAMES, ROUNDS, Cell, Plan, entries, jobs, parse_variant, replay_command
from eval.report_runs import Task
from pacman_env.config import ConfigError, make_config

HOUSE, LEVELS = Task("house", "some folder/house.yaml"), Task("generated:test", "generated:test", 7)


def plan(*variants: str, speeds: tuple[float, ...] = (0.2, 0.25), settings: tuple[str, ...] = ()) -> Plan:
    return Plan(
        tasks=(HOUSE, LEVELS),
        policies=entries(["clyde_aware", "nearest"]),
        baseline="clyde_aware",
        preset="ideal",
        execution="as_built",
        settings=settings,
        config=make_config("ideal", "as_built"),
        speeds=speeds,
        variants=tuple(parse_variant(text, "ideal", "as_built", settings) for text in variants),
        seed=0,
        seeds=episode_seeds(0, 3),
        endless_seeds=episode_seeds(0, 2),
    )


def test_everything_is_played_once() -> None:
    work = jobs(plan("slow=robot.speed_mps=0.2"))
    house = {cell: job for cell, job in work.items() if cell.task == "house"}
    assert list(house) == [
        Cell(part, "house", policy, speed)
        for part, speed in ((ROUNDS, 0.25), (ROUNDS, 0.2), (ENDLESS_GAMES, 0.25), ("slow", 0.25))
        for policy in ("clyde_aware", "nearest")
    ]
    assert len(work) == 2 * len(house)
    for cell, job in work.items():
        assert job.config.clyde.speed_mps == cell.speed
        assert job.config.endless == (cell.part == ENDLESS_GAMES)
        assert job.config.robot.speed_mps == (0.2 if cell.part == "slow" else 0.306)
        assert len(job.seeds) == (2 if cell.part == ENDLESS_GAMES else 3)


@pytest.mark.parametrize("separator", [",", ";", " ", ", "])
def test_a_variant_changes_what_it_names_and_nothing_else(separator: str) -> None:
    text = "my name=" + separator.join(["preset=robot", "randomize.clyde_speed_mps=0.2,0.5", "refuges.nooks=0"])
    variant = parse_variant(text, "ideal", "as_built", ["refuges.spread=3"])
    assert variant.name == "my name"
    fields = {"refuges.spread": 3, "refuges.nooks": 0, "randomize.clyde_speed_mps": (0.2, 0.5)}
    assert variant.config == make_config("robot", "as_built", **fields)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("calm", "must be NAME=SETTINGS"),
        ("=preset=ideal", "must be NAME=SETTINGS"),
        ("calm=", "must be NAME=SETTINGS"),
        ("calm=preset", "must be NAME=SETTINGS"),
        ("rounds=preset=ideal", "--variant rounds"),
        ("calm=clyde.haste=1", "--variant calm: unknown configuration field 'clyde.haste'"),
        ("calm=preset=perfect", "--variant calm: unknown preset 'perfect'"),
    ],
)
def test_a_wrong_variant_is_named(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse_variant(text, "robot", "robust", ())


def test_files_go_by_their_stem_where_that_is_enough() -> None:
    labels = [entry.label for entry in entries(["nearest", "a/one.onnx", "b/one.onnx", "a/two.onnx", "nearest"])]
    assert labels == ["nearest", "a/one.onnx", "b/one.onnx", "two"]


def test_a_replay_repeats_everything_that_decides_a_round() -> None:
    words = shlex.split(replay_command(plan(settings=("refuges.nooks=0", "time_limit_s=60")), HOUSE, 2**63))
    assert words[:6] == ["python", "-m", "eval.replay", str(2**63), "--map", "some folder/house.yaml"]
    assert words[6:11] == ["--policies", "nearest", "clyde_aware", "--clyde-speed", "0.25"]
    assert words[11:15] == ["--preset", "ideal", "--execution", "as_built"]
    assert words[15:] == ["--set", "refuges.nooks=0", "--set", "time_limit_s=60"]
    words = shlex.split(replay_command(plan(), LEVELS, 5))
    assert words[4:8] == ["--levels", "test", "--num-levels", "7"]


def test_the_challenger_is_the_first_that_is_not_the_baseline() -> None:
    challenger = plan().challenger
    assert challenger is not None
    assert challenger.label == "nearest"


def test_a_path_is_no_name(tmp_path: Path) -> None:
    (entry,) = entries([str(tmp_path / "planner.onnx")])
    assert (entry.label, entry.spec) == ("planner", str(tmp_path / "planner.onnx"))
