"""The games that a planner is trained on, in parts with line-ups and houses of their own."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

from pacman_env.heuristics.simple import Nearest
from pacman_env.policies.registry import make_policy
from pacman_env.sb3 import PacManBotVecEnv
from pacman_env.sim.maps.level_source import TEST_LEVEL, ListedMaps
from pacman_env.sim.observation.planner_features import CANDIDATE_FEATURES
from pacman_env.training.arguments import Arguments
from pacman_env.training.games import (
    VALIDATION_LEVEL,
    Ending,
    PlannerGames,
    PlannerPart,
    clyde_limit,
    dropped,
    game_config,
    lineup_speeds,
    make_parts,
)
from pacman_env.training.train import parse
from tests.envs.helpers import QUICK
from tests.training.stock import random_choices
from tests.training.test_arguments import tiny


def parts_of(arguments: Arguments, segment: int = 0, **changes: Any) -> list[PacManBotVecEnv]:
    return [part.make(part.policies()).env for part in make_parts(arguments, segment, **changes)]


def levels(arguments: Arguments, segment: int) -> range:
    """That a segment's games are drawn from, all parts together."""
    sources = [part.env.batch.source for part in parts_of(arguments, segment)]
    for one, following in itertools.pairwise(sources):
        assert following.start_level == one.start_level + one.num_levels  # type: ignore[attr-defined]
    count = sum(source.num_levels for source in sources)  # type: ignore[attr-defined]
    return range(sources[0].start_level, sources[0].start_level + count)  # type: ignore[attr-defined]


def test_reward_scale_changes_rewards_only() -> None:
    plain, scaled = (PacManBotVecEnv(4, map="house", settings=QUICK) for _ in range(2))
    games = PlannerGames(scaled, 0.2)
    rng = np.random.default_rng(0)
    plain.seed(5)
    plain.reset()
    games.reset(5)
    ended = 0
    for _ in range(60):
        actions = rng.integers(plain.action_space.n, size=4)  # type: ignore[attr-defined]
        expected, found = plain.step(actions), games.step(actions)
        assert (found[1] == expected[1] * np.float32(0.2)).all()
        assert found[1].dtype == np.float32
        assert (found[2] == expected[2]).all()
        assert all((found[0][key] == expected[0][key]).all() for key in expected[0])
        infos = [info for info, done in zip(expected[3], expected[2], strict=True) if done]
        assert found.endings == [
            Ending(info["outcome"], None, info["episode"]["r"], info["episode"]["l"]) for info in infos
        ]
        ended += int(expected[2].sum())
    assert ended > 0


def test_timeout_is_recorded_as_ending() -> None:
    games = PlannerGames(PacManBotVecEnv(3, map="house", settings={"time_limit_s": 1.0}))
    games.reset(1)
    hold = np.full(3, games.env.env.batch.hold)
    for _ in range(2):
        step = games.step(hold)
    assert step.dones.all()
    assert [ending.outcome for ending in step.endings] == ["timeout"] * 3


def test_each_segment_plays_its_own_levels() -> None:
    arguments = tiny(levels=3)
    found = [levels(arguments, segment) for segment in range(3)]
    assert len(set().union(*found)) == 9
    full = parse([])
    assert full.hyper.segments * full.hyper.levels <= VALIDATION_LEVEL  # none is met twice


def test_training_levels_exclude_validation_and_test_levels() -> None:
    """However many segments there are: after the last level comes the first."""
    arguments = tiny(levels=7)
    last = VALIDATION_LEVEL // 7 - 1
    assert levels(arguments, last) == range(7 * last, 7 * last + 7)
    assert levels(arguments, last).stop <= VALIDATION_LEVEL < TEST_LEVEL
    assert levels(arguments, last + 1) == levels(arguments, 0)


def test_too_many_levels_are_refused() -> None:
    with pytest.raises(ValueError, match="levels = 900001: there are 900000 to train on"):
        make_parts(tiny(levels=VALIDATION_LEVEL + 1), 0)


def test_games_draw_speeds_from_configured_ranges() -> None:
    speeds = {"clyde_speed": [0.3, 0.4], "robot_speed": [0.25, 0.28]}
    (part,) = parts_of(tiny(games=64, n_steps=1, levels=1, **speeds))
    part.reset()
    env = part.env
    speeds = env.batch.games["clyde_speed"]
    assert 0.3 <= speeds.min() < speeds.max() <= 0.4
    assert env.config.randomize.speed_mps == (0.25, 0.28)


def test_curriculum_raises_ghost_speed_to_the_maximum() -> None:
    arguments = tiny(curriculum=True, decisions=640)
    limits = [clyde_limit(arguments, segment) for segment in range(10)]
    low, high = arguments.hyper.clyde_speed
    assert low < limits[0] < limits[1] < limits[2] < limits[3] < limits[4]
    assert limits[4:] == [pytest.approx(high)] * 6
    assert clyde_limit(tiny(), 0) is None
    found = [lineup_speeds(arguments, "wander", limit) for limit in (limits[0], None, 9.0, 0.01)]
    assert found == [(low, limits[0]), (low, high), (low, high), (low, low)]
    assert lineup_speeds(arguments, "chase@0.1-0.3", 0.2) == (0.1, 0.2)


def test_lineup_with_own_speeds_uses_them() -> None:
    parts = parts_of(tiny(ghosts=["wander", "chase@0.1-0.15"], games=4, levels=4))
    assert {(ghosts_of(part), part.env.config.randomize.clyde_speed_mps) for part in parts} == {
        ("wander", (0.2, 0.6)),
        ("chase", (0.1, 0.15)),
    }


def test_each_part_has_own_policy_for_learned_ghost() -> None:
    arguments = tiny(ghosts=["wander", "wander,learned"], games=4, levels=4, league_every=1)
    parts = make_parts(arguments, 0, Nearest())
    policies = [part.policies() for part in parts]
    assert sorted(map(len, policies)) == [0, 0, 1, 1]
    assert len({id(one) for own in policies for one in own}) == 2
    places = []
    for part, own in zip(parts, policies, strict=True):
        games, rng = part.make(own), np.random.default_rng(0)
        observation = games.reset(0)
        for _ in range(5):
            observation = games.step(random_choices(observation["action_mask"], rng)).observation
        assert ghosts_of(games.env) == ("wander,policy" if own else "wander")
        places += games.env.env.batch.ghosts["place"][:, 1].tolist() if own else []
    assert max(places) >= 0


def test_repeated_levels_replace_at_most_half_of_levels() -> None:
    arguments = tiny(ghosts=["wander", "chase"], games=8, levels=16)  # four parts of four levels
    parts = parts_of(arguments, 3, again={"chase": [7, 5, 3], "wander": [1]})
    found: dict[str, list[list[int]]] = {}
    for part in parts:
        source = part.env.batch.source
        assert isinstance(source, ListedMaps)
        found.setdefault(ghosts_of(part) + " wide" * (source.scale > 1), []).append(source.levels.tolist())
    own = list(range(48, 64))
    played = [level for lists in found.values() for one in lists for level in one]
    assert set(played) - set(own) in ({1, 3, 5, 7}, {1, 5, 7})  # one of chase's two parts may be in wide houses
    assert all(set(level) <= set(own) for name, lists in found.items() if "wide" in name for level in lists)
    assert len(played) == 16


def test_curriculum_of_one_segment_uses_full_speed() -> None:
    assert clyde_limit(tiny(curriculum=True, decisions=64), 0) == pytest.approx(0.6)


def test_randomize_option_draws_aborts_and_localization_noise() -> None:
    plain, drawn = game_config(tiny()).randomize, game_config(tiny(randomize=True)).randomize
    assert plain.abort_rate is None
    assert drawn.abort_rate == (0.0, 0.02)
    assert drawn.sigma_xy_m == (0.0, 0.07)
    assert plain.clyde_speed_mps == drawn.clyde_speed_mps


def test_ablations_drop_existing_and_different_columns() -> None:
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


def test_quarter_of_games_is_played_in_wide_houses() -> None:
    arguments = tiny(games=8, n_steps=8, levels=9)
    parts = parts_of(arguments)
    assert [part.num_envs for part in parts] == [2, 2, 2, 2]
    assert [part.env.config.pellets.spacing_m for part in parts] == [2.0, 2.0, 2.0, 4.0]


def test_few_games_or_levels_make_fewer_parts() -> None:
    assert [part.num_envs for part in parts_of(tiny(games=2, n_steps=16, levels=9))] == [1, 1]
    assert [part.num_envs for part in parts_of(tiny(games=4, levels=1))] == [4]


TWO = {"ghosts": ["chase", "wander,wander"], "games": 8, "levels": 8}


def ghosts_of(part: PacManBotVecEnv) -> str:
    return ",".join(part.env.config.clyde.ghosts)


def test_every_lineup_gets_equal_share_in_every_segment() -> None:
    arguments = tiny(**TWO)
    for segment in range(2):
        parts = parts_of(arguments, segment)
        assert [(ghosts_of(part), part.num_envs) for part in parts] == [("wander,wander", 2), ("chase", 2)] * 2
        assert levels(arguments, segment) == range(8 * segment, 8 * segment + 8)
    twice = parts_of(tiny(ghosts=["chase", "wander", "wander", "wander"], levels=4))
    assert sorted(map(ghosts_of, twice)) == ["chase", "wander", "wander", "wander"]


def test_wide_houses_rotate_over_parts_with_several_lineups() -> None:
    wide = [
        [part.env.config.pellets.spacing_m == 4.0 for part in parts_of(tiny(**TWO), segment)] for segment in range(4)
    ]
    assert [row.index(True) for row in wide] == [3, 2, 1, 0]
    assert all(sum(row) == 1 for row in wide)
    one = [[part.env.config.pellets.spacing_m for part in parts_of(tiny(levels=4), segment)] for segment in range(2)]
    assert one == [[2.0, 2.0, 2.0, 4.0]] * 2


@pytest.mark.parametrize("ghosts", [["wander"], ["wander", "wander", "wander"]])
def test_single_lineup_plays_games_of_plain_environment(ghosts: list[str]) -> None:
    """However often it is listed, and as when environments were made without naming their ghost."""
    arguments = tiny(ghosts=ghosts, levels=4)
    for part, env in zip(make_parts(arguments, 1), parts_of(arguments, 1), strict=True):
        config = env.env.config.with_fields(**{"clyde.ghosts": type(env.env.config)().clyde.ghosts})
        assert config == env.env.config
        source: Any = env.env.batch.source
        config = config.with_fields(start_level=source.start_level, num_levels=source.num_levels)
        name = "generated:wide" if config.pellets.spacing_m == 4.0 else "generated"
        plain = PlannerGames(PacManBotVecEnv(env.num_envs, map=name, settings=config), part.scale)
        found = part.make([])
        seen, same = found.reset(5), plain.reset(5)
        rng = np.random.default_rng(0)
        for _ in range(20):
            assert all((seen[key] == same[key]).all() for key in seen)
            actions = random_choices(seen["action_mask"], rng)
            (seen, rewards, *_), (same, others, *_) = found.step(actions), plain.step(actions)
            assert (rewards == others).all()


def test_curriculum_limits_ghost_speeds_of_all_lineups() -> None:
    arguments = tiny(**TWO, curriculum=True, randomize=True, decisions=640)
    limit = clyde_limit(arguments, 0)
    for part in parts_of(arguments):
        part.reset()
        assert part.env.config.randomize.clyde_speed_mps == (0.2, limit)
        ghosts = part.env.batch.ghosts
        assert (ghosts["speed"] == part.env.batch.games["clyde_speed"][:, None]).all()


def test_teacher_chooses_like_its_policy_alone() -> None:
    (part,) = make_parts(tiny(games=8, n_steps=8, levels=1), 0)
    assert isinstance(part, PlannerPart)
    games, rule = part.make([]), make_policy("lookahead")
    games.reset(3)
    games.begin_teaching()
    rule.reset(np.ones(8, dtype=np.bool_), games.env.env.config)
    for _ in range(10):
        choices = games.choices()
        assert choices.tolist() == rule.select(games.env.env.situation).tolist()
        dones = games.step(choices).dones
        rule.reset(dones, games.env.env.config)
