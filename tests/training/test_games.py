"""The games that a planner is trained on, in parts with line-ups and houses of their own."""

import itertools
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

from pacman_env.heuristics.simple import Nearest
from pacman_env.levels.house_families import HOUSES, LONG_HOUSES, WIDE_HOUSES
from pacman_env.levels.level_source import TEST_LEVEL, ListedMaps
from pacman_env.observations.planner_features import CANDIDATE_FEATURES
from pacman_env.sb3 import PacManBotVecEnv
from pacman_env.training.arguments import Arguments, parse
from pacman_env.training.games import (
    VALIDATION_LEVEL,
    Ending,
    PlannerGames,
    clyde_limit,
    dropped,
    game_config,
    lineup_settings,
    make_parts,
    to_repeat,
)
from tests.envs.helpers import QUICK
from tests.training.stock import random_choices
from tests.training.test_arguments import tiny


def parts_of(arguments: Arguments, segment: int = 0, **changes: Any) -> list[PacManBotVecEnv]:
    return [part.env for part in make_parts(arguments, segment, **changes)]


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
        assert (found.rewards == expected[1] * np.float32(0.2)).all()
        assert found.rewards.dtype == np.float32
        assert (found.dones == expected[2]).all()
        assert all((games.observation[key] == expected[0][key]).all() for key in expected[0])
        infos = [info for info, done in zip(expected[3], expected[2], strict=True) if done]
        assert found.endings == [
            Ending(info["outcome"], info["episode"]["r"], info["episode"]["l"], "wander") for info in infos
        ]
        ended += int(expected[2].sum())
    assert ended > 0


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


def test_curriculum_raises_ghost_speed_to_the_maximum() -> None:
    arguments = tiny(curriculum=True, decisions=640)
    limits = [clyde_limit(arguments, segment) for segment in range(10)]
    low, high = arguments.hyper.clyde_speed
    assert low < limits[0] < limits[1] < limits[2] < limits[3] < limits[4]
    assert limits[4:] == [pytest.approx(high)] * 6
    assert clyde_limit(tiny(), 0) is None
    assert clyde_limit(tiny(curriculum=True, decisions=64), 0) == pytest.approx(high)
    speeds = "randomize.clyde_speed_mps"
    found = [lineup_settings(arguments, "wander", limit)[speeds] for limit in (limits[0], None, 9.0, 0.01)]
    assert found == [(low, limits[0]), (low, high), (low, high), (low, low)]
    assert lineup_settings(arguments, "chase@0.1-0.3+4", 0.2) == {speeds: (0.1, 0.2), "power.pellets": 4}


def test_lineup_with_own_speeds_uses_them() -> None:
    parts = parts_of(tiny(ghosts=["wander", "chase@0.1-0.15"], games=4, levels=4))
    found = {(ghosts_of(part), part.env.config.randomize.clyde_speed_mps) for part in parts}
    assert found == {("wander", (0.2, 0.6)), ("chase", (0.1, 0.15))}
    assert {part.env.config.randomize.speed_mps for part in parts} == {(0.22, 0.306)}


def test_each_part_has_own_policy_for_learned_ghost() -> None:
    arguments = tiny(ghosts=["wander", "wander,learned"], games=4, levels=4, league_every=1)
    parts = make_parts(arguments, 0, Nearest())
    places, lineups = [], []
    for games in parts:
        rng = np.random.default_rng(0)
        games.reset(0)
        for _ in range(5):
            games.step(random_choices(games.observation["action_mask"], rng))
        lineups.append(ghosts_of(games.env))
        places += games.env.env.batch.ghosts["place"][:, 1].tolist() if "policy" in lineups[-1] else []
    assert sorted(lineups) == ["wander", "wander", "wander,policy", "wander,policy"]
    assert max(places) >= 0


def test_repeated_levels_replace_at_most_half_of_levels() -> None:
    arguments = tiny(ghosts=["wander", "chase"], games=8, levels=16)  # four parts of four levels
    again: dict[str, list[int]] = {"chase": [7, 5, 3], "wander": [1]}  # one part plays usual houses
    met: set[int] = set()
    for segment in (3, 4):
        own, played = set(range(16 * segment, 16 * segment + 16)), 0
        for part in parts_of(arguments, segment, again=again):
            source = part.env.batch.source
            assert isinstance(source, ListedMaps)
            old = set(source.levels.tolist()) - own
            assert old <= set(again[ghosts_of(part)])
            assert len(old) <= (2 if source.family is HOUSES else 0)  # not in wide or long houses
            met |= old
            played += len(source.levels)
        assert played == 16
    assert met == {1, 5, 7}


def test_every_lineup_meets_usual_houses_twice_in_a_row() -> None:
    arguments = tiny(ghosts=["wander", "chase"], games=8, levels=16)
    segments = [{part.lineup for part in make_parts(arguments, k) if part.may_repeat} for k in range(4)]
    assert set().union(*(one & following for one, following in itertools.pairwise(segments))) == {"wander", "chase"}


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


TWO = {"ghosts": ["chase", "wander,wander"], "games": 8, "levels": 8}
#: Arguments, a segment, the line-up of each part, and the place of the first part in the order of houses.
PARTS: list[tuple[dict[str, Any], int, list[str], int]] = [
    ({"games": 8, "n_steps": 8, "levels": 9}, 0, ["wander"] * 4, 0),
    ({"levels": 4}, 1, ["wander"] * 4, 0),
    ({"ghosts": ["wander"] * 3, "levels": 4}, 0, ["wander"] * 4, 0),
    ({"games": 2, "n_steps": 16, "levels": 9}, 0, ["wander"] * 2, 0),
    ({"levels": 1}, 0, ["wander"], 0),
    ({"ghosts": ["chase", *["wander"] * 3], "levels": 4}, 0, ["wander", "chase", "wander", "wander"], 0),
    *((TWO, segment, ["wander,wander", "chase"] * 2, segment // 2) for segment in range(0, 8, 2)),
]


@pytest.mark.parametrize(("changes", "segment", "lineups", "first"), PARTS)
def test_parts_share_games_and_kinds_of_houses(
    changes: dict[str, Any], segment: int, lineups: list[str], first: int
) -> None:
    arguments = tiny(**changes)
    parts = parts_of(arguments, segment)
    assert [ghosts_of(part) for part in parts] == lineups
    assert {part.num_envs for part in parts} == {arguments.hyper.games // len(lineups)}
    families = [HOUSES, LONG_HOUSES, LONG_HOUSES, WIDE_HOUSES] * 2
    for part, family in zip(parts, families[first:], strict=False):
        assert isinstance(part.env.batch.source, ListedMaps)
        assert part.env.batch.source.family is family
        assert part.env.config.pellets.spacing_m == family.spacing_m


SPARSE = {"pellets.spacing_m": 2.5}


def test_parts_keep_spacing_of_preset() -> None:
    """Twice as wide in wide houses."""
    parts = parts_of(tiny(games=4, levels=4, preset=f"{__name__}:SPARSE"))
    assert [part.env.config.pellets.spacing_m for part in parts] == [2.5, 2.5, 2.5, 5.0]


def ghosts_of(part: PacManBotVecEnv) -> str:
    return ",".join(part.env.config.clyde.ghosts)


def test_curriculum_limits_ghost_speeds_of_all_lineups() -> None:
    arguments = tiny(**TWO, curriculum=True, randomize=True, decisions=640)
    limit = clyde_limit(arguments, 0)
    for part in parts_of(arguments):
        part.reset()
        assert part.env.config.randomize.clyde_speed_mps == (0.2, limit)
        ghosts = part.env.batch.ghosts
        assert (ghosts["speed"] == part.env.batch.games["clyde_speed"][:, None]).all()


def rounds(*counts: tuple[str, int, int, int]) -> list[Ending]:
    """``counts``: against a line-up, on a level: completed rounds, all rounds."""
    outcomes = {True: "complete", False: "caught"}
    return [Ending(outcomes[k < won], lineup=lineup, level=level) for lineup, level, won, n in counts for k in range(n)]


def test_half_completed_levels_are_repeated_first() -> None:
    chase = [(3, 1, 10), (5, 5, 10), (9, 0, 10), (2, 10, 10), (4, 3, 10), (1, 4, 9)]
    found = to_repeat(rounds(*(("chase", *one) for one in chase)))
    assert found == {"chase": [5, 1, 4]}  # of six; 9 is never completed, 2 always


def test_levels_with_few_rounds_are_not_repeated() -> None:
    assert to_repeat(rounds(("chase", 1, 2, 5), ("chase", 2, 3, 6))) == {"chase": [2]}


def test_repeated_levels_are_separate_for_each_lineup() -> None:
    found = to_repeat(rounds(("chase", 1, 3, 6), ("wander", 3, 3, 6), ("chase", 4, 2, 6)))
    assert found == {"chase": [1], "wander": []}  # half of two, half of one
