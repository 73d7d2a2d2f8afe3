"""The games that a planner is trained on: rewards scaled, no ending excused, houses that nobody is judged on."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

from pacman_env.sb3 import PacManBotVecEnv
from pacman_env.sim.maps.generated import TEST_LEVEL
from pacman_env.sim.observation.planner_features import CANDIDATE_FEATURES
from pacman_env.training.arguments import Arguments
from pacman_env.training.games import VALIDATION_LEVEL, TrainingGames, clyde_limit, dropped, game_config, make_games
from pacman_env.training.ppo import parse
from tests.envs.helpers import QUICK
from tests.training.test_arguments import tiny


def parts_of(arguments: Arguments, segment: int = 0) -> list[PacManBotVecEnv]:
    return make_games(arguments, segment).venv.games  # type: ignore[attr-defined]


def levels(arguments: Arguments, segment: int) -> range:
    """That a segment's games are drawn from, all parts together."""
    sources = [part.env.batch.source for part in parts_of(arguments, segment)]
    for one, following in itertools.pairwise(sources):
        assert following.start_level == one.start_level + one.num_levels  # type: ignore[attr-defined]
    count = sum(source.num_levels for source in sources)  # type: ignore[attr-defined]
    return range(sources[0].start_level, sources[0].start_level + count)  # type: ignore[attr-defined]


def test_rewards_are_scaled_and_all_else_is_left() -> None:
    plain, scaled = (PacManBotVecEnv(4, map="house", settings=QUICK) for _ in range(2))
    games = TrainingGames(scaled, 0.2)
    rng = np.random.default_rng(0)
    for env in (plain, games):
        env.seed(5)
        env.reset()
    ended = 0
    for _ in range(60):
        actions = rng.integers(plain.action_space.n, size=4)  # type: ignore[attr-defined]
        expected, found = plain.step(actions), games.step(actions)
        assert (found[1] == expected[1] * np.float32(0.2)).all()
        assert found[1].dtype == np.float32
        assert (found[2] == expected[2]).all()
        assert all((found[0][key] == expected[0][key]).all() for key in expected[0])
        ended += int(expected[2].sum())
    assert ended > 0


def test_a_time_out_is_an_ending_without_a_value_after_it() -> None:
    plain, limited = (PacManBotVecEnv(3, map="house", settings={"time_limit_s": 1.0}) for _ in range(2))
    games = TrainingGames(limited, 1.0)
    for env in (plain, games):
        env.seed(1)
        env.reset()
    for _ in range(2):
        hold = np.full(3, plain.action_space.n - 1)  # type: ignore[attr-defined]
        excused, ours = plain.step(hold), games.step(hold)
    for row, other in zip(excused[3], ours[3], strict=True):
        assert row["outcome"] == other["outcome"] == "timeout"
        assert row["TimeLimit.truncated"]
        assert not other["TimeLimit.truncated"]
    assert ours[2].all()


def test_segments_are_played_on_levels_of_their_own() -> None:
    arguments = tiny(levels=3)
    found = [levels(arguments, segment) for segment in range(3)]
    assert len(set().union(*found)) == 9
    full = parse([])
    assert full.hyper.segments * full.hyper.levels <= VALIDATION_LEVEL  # none is met twice


def test_training_levels_are_neither_validated_on_nor_tested_on() -> None:
    """However many segments there are: after the last level comes the first."""
    arguments = tiny(levels=7)
    last = VALIDATION_LEVEL // 7 - 1
    assert levels(arguments, last) == range(7 * last, 7 * last + 7)
    assert levels(arguments, last).stop <= VALIDATION_LEVEL < TEST_LEVEL
    assert levels(arguments, last + 1) == levels(arguments, 0)


def test_more_levels_than_there_are_to_train_on_are_refused() -> None:
    with pytest.raises(ValueError, match="levels = 900001: there are 900000 to train on"):
        make_games(tiny(levels=VALIDATION_LEVEL + 1), 0)


def test_games_are_met_with_the_speeds_asked_for() -> None:
    games = make_games(tiny(games=64, n_steps=1, levels=1, clyde_speed=[0.3, 0.4], robot_speed=[0.25, 0.28]), 0)
    games.seed(0)
    games.reset()
    env = games.venv.games[0].env  # type: ignore[attr-defined]
    speeds = env.batch.games["clyde_speed"]
    assert 0.3 <= speeds.min() < speeds.max() <= 0.4
    assert env.config.randomize.speed_mps == (0.25, 0.28)


def test_the_curriculum_begins_slow_and_ends_at_the_highest_speed() -> None:
    arguments = tiny(curriculum=True, decisions=640)
    limits = [clyde_limit(arguments, segment) for segment in range(10)]
    low, high = arguments.hyper.clyde_speed
    assert low < limits[0] < limits[1] < limits[2] < limits[3] < limits[4]
    assert limits[4:] == [pytest.approx(high)] * 6
    assert clyde_limit(tiny(), 0) is None
    caught_at = [game_config(arguments, limit).randomize.clyde_speed_mps for limit in (limits[0], None, 9.0, 0.01)]
    assert caught_at == [(low, limits[0]), (low, high), (low, high), (low, low)]


def test_a_curriculum_of_one_segment_is_none() -> None:
    assert clyde_limit(tiny(curriculum=True, decisions=64), 0) == pytest.approx(0.6)


def test_randomize_draws_what_else_the_real_robot_met() -> None:
    plain, drawn = game_config(tiny()).randomize, game_config(tiny(randomize=True)).randomize
    assert plain.abort_rate is None
    assert drawn.abort_rate == (0.0, 0.02)
    assert drawn.sigma_xy_m == (0.0, 0.07)
    assert plain.clyde_speed_mps == drawn.clyde_speed_mps


def test_ablations_drop_columns_that_exist_and_each_its_own() -> None:
    assert dropped(tiny()) == {"dropped_features": (), "dropped_kinds": ()}
    parts = {part: dropped(tiny(without=(part,))) for part in ("paths", "prediction", "refuges", "hold")}
    kinds = {part: [CANDIDATE_FEATURES[k] for k in parts[part]["dropped_kinds"]] for part in parts}
    assert kinds == {"paths": [], "prediction": [], "refuges": ["is_refuge"], "hold": ["is_hold"]}
    paths, prediction = (set(parts[part]["dropped_features"]) for part in ("paths", "prediction"))
    assert len(paths) == 8
    assert len(prediction) == 6
    assert not paths & prediction
    together = dropped(tiny(without=("paths", "prediction", "refuges", "hold")))
    assert set(together["dropped_features"]) == paths | prediction
    assert len(together["dropped_kinds"]) == 2


def test_a_quarter_of_the_games_is_played_in_wide_houses() -> None:
    arguments = tiny(games=8, n_steps=8, levels=9)
    parts = parts_of(arguments)
    assert [part.num_envs for part in parts] == [2, 2, 2, 2]
    assert [part.env.config.pellets.spacing_m for part in parts] == [2.0, 2.0, 2.0, 4.0]


def test_fewer_games_or_levels_than_parts_make_fewer_parts() -> None:
    assert [part.num_envs for part in parts_of(tiny(games=2, n_steps=16, levels=9))] == [1, 1]
    assert [part.num_envs for part in parts_of(tiny(games=4, levels=1))] == [4]
