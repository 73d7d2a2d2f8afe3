import shlex

import pytest

from pacman_env.config import make_config
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.report.plan import (
    ENDLESS_GAMES,
    ROUNDS,
    ReportPlan,
    RoundsKey,
    matchups,
    parse_variant,
    replay_command,
)
from pacman_env.evaluation.rounds.scenarios import Levels, Scenario

HOUSE, LEVELS = "some folder/house.yaml", Levels("test", None, 7)


def plan(*variants: str, settings: tuple[str, ...] = (), file: str = "runs/best.onnx", **maps: Scenario) -> ReportPlan:
    return ReportPlan(
        maps={"house": HOUSE, "generated:test": LEVELS, **maps},
        policies={"clyde_aware": "clyde_aware", "best": file},
        baseline="clyde_aware",
        preset="ideal",
        execution="as_built",
        settings=settings,
        config=make_config("ideal", "as_built"),
        speeds=(0.2, 0.25),
        variants=tuple(parse_variant(text, "ideal", "as_built", settings) for text in variants),
        seed=0,
        seeds=episode_seeds(0, 3),
        endless_seeds=episode_seeds(0, 2),
    )


def test_plan_plays_every_matchup_once() -> None:
    work = matchups(plan("slow=robot.speed_mps=0.2"))
    house = {cell: matchup for cell, matchup in work.items() if cell.map == "house"}
    assert list(house) == [
        RoundsKey(part, "house", policy, speed)
        for part, speed in ((ROUNDS, 0.25), (ROUNDS, 0.2), (ENDLESS_GAMES, 0.25), ("slow", 0.25))
        for policy in ("clyde_aware", "best")
    ]
    assert len(work) == 2 * len(house)
    for cell, matchup in work.items():
        assert matchup.scenario == (HOUSE if cell.map == "house" else LEVELS)
        assert matchup.policy == ("runs/best.onnx" if cell.policy == "best" else "clyde_aware")
        assert matchup.config.clyde.speed_mps == cell.speed
        assert matchup.config.endless == (cell.part == ENDLESS_GAMES)
        assert matchup.config.robot.speed_mps == (0.2 if cell.part == "slow" else 0.306)
        assert len(matchup.seeds) == (2 if cell.part == ENDLESS_GAMES else 3)


@pytest.mark.parametrize("separator", [",", ";", " ", ", "])
def test_variant_changes_only_its_named_fields(separator: str) -> None:
    text = "my name=" + separator.join(["preset=robot", "randomize.clyde_speed_mps=0.2,0.5", "refuges.nooks=0"])
    variant = parse_variant(text, "ideal", "as_built", ["refuges.spread=3"])
    assert variant.name == "my name"
    fields = {"refuges.spread": 3, "refuges.nooks": 0, "randomize.clyde_speed_mps": (0.2, 0.5)}
    assert variant.config == make_config("robot", "as_built", **fields)


def test_replay_command_contains_everything_about_a_round() -> None:
    words = shlex.split(replay_command(plan(settings=("refuges.nooks=0", "time_limit_s=60")), "house", 2**63))
    assert words[:5] == ["pacman-env", "replay", str(2**63), "--map", "some folder/house.yaml"]
    assert words[5:10] == ["--policies", "runs/best.onnx", "clyde_aware", "--clyde-speed", "0.25"]
    assert words[10:14] == ["--preset", "ideal", "--execution", "as_built"]
    assert words[14:] == ["--set", "refuges.nooks=0", "--set", "time_limit_s=60"]
    words = shlex.split(replay_command(plan(), "generated:test", 5))
    assert words[3:7] == ["--levels", "test", "--num-levels", "7"]
    assert words[7:11] == ["--policies", "runs/best.onnx", "clyde_aware", "--clyde-speed"]
    words = shlex.split(replay_command(plan(file="a.zip", some=Levels("train", 5, 9)), "some", 5))
    assert words[3:9] == ["--levels", "train", "--num-levels", "9", "--start-level", "5"]
    assert words[9:12] == ["--policies", "a.zip", "clyde_aware"]
