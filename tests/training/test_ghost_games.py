"""Clyde's games are the PettingZoo environment's."""

from functools import partial
from typing import Any

import numpy as np
import pytest

pytest.importorskip("sb3_contrib")

import pacman_env
from pacman_env.envs.parallel_vec_env import PACMAN, PacManBotParallelVecEnv
from pacman_env.observations.planner_features import planner_features
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.registry import make_policy
from pacman_env.training.games import CLYDE, GhostGames, game_settings, make_ghost_parts
from tests.training.test_arguments import tiny

GAMES, SCALE = 3, 0.5
ARGUMENTS = tiny(games=GAMES, segment=GAMES * 64, levels=2 * GAMES, reward_scale=SCALE, batch_size=8)
ROBOT = partial(make_policy, "nearest")
QUICK = {"map": "house", "settings": {"time_limit_s": 6.0}}  # rounds are over soon


def begun(count: int, seed: int = 5) -> GhostGames:
    games = GhostGames(PacManBotParallelVecEnv(count, **QUICK), ROBOT(), SCALE)
    games.reset(seed)
    return games


def made(segment: int = 0) -> list[GhostGames]:
    return make_ghost_parts(ARGUMENTS, segment, ROBOT())


def count(games: GhostGames) -> int:
    return games.env.batch.candidates


def test_ghost_games_equal_environments_with_policy_driven_robot() -> None:
    games = begun(GAMES)
    twins, robots = [pacman_env.parallel_env(**QUICK) for _ in range(GAMES)], [ROBOT() for _ in range(GAMES)]
    for i, twin in enumerate(twins):
        twin.reset(5 + i)
    rng = np.random.default_rng(0)
    ends = 0
    for _ in range(30):
        choices = rng.integers(count(games), size=GAMES)
        rewards, dones, endings = games.step(choices)
        assert len(endings) == dones.sum()
        left = iter(endings)
        for i, (twin, robot) in enumerate(zip(twins, robots, strict=True)):
            goal = robot.select(situation_of(twin.batch))[0]
            _, reward, _, _, info = twin.step({PACMAN: goal, CLYDE: choices[i]})
            assert rewards[i] == np.float32(-SCALE * reward[PACMAN])
            assert dones[i] == (not twin.agents)
            if dones[i]:
                assert next(left).outcome == info[CLYDE]["outcome"]
                ends += 1
                twin.reset()
            seen = planner_features(situation_of(twin.batch, 0), twin.config.robot.speed_mps)
            np.testing.assert_array_equal(games.observation["planner_candidates"][i], seen[0][0])
            np.testing.assert_array_equal(games.observation["planner_globals"][i], seen[1][0])
            np.testing.assert_array_equal(games.observation["action_mask"][i], situation_of(twin.batch, 0).mask[0])
    assert ends >= 2 * GAMES


def test_each_segment_plays_its_own_houses() -> None:
    for segment, first in ((0, 0), (1, 6)):
        parts = made(segment)
        assert sum(part.num_envs for part in parts) == GAMES
        sources: list[Any] = [part.env.batch.source for part in parts]
        assert {(source.start_level, source.num_levels) for source in sources} == {(first, 6)}


def test_ghost_games_use_scale_and_speeds_of_planner_training() -> None:
    (games, *_), settings = made(), game_settings(ARGUMENTS)
    for name in ("clyde_speed_mps", "speed_mps"):
        assert getattr(games.env.config.randomize, name) == settings[f"randomize.{name}"]
    assert games.env.config.zero_sum
    assert {part.scale for part in make_ghost_parts(ARGUMENTS, 0, ROBOT())} == {SCALE}


@pytest.mark.parametrize("ghosts", [("policy", "policy"), ("wander", "policy")], ids=["two agents", "not clyde"])
def test_games_with_other_agents_are_refused(ghosts: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=r"agents of the games: .*, must be pacman and clyde"):
        GhostGames(PacManBotParallelVecEnv(1, map="house", ghosts=ghosts), ROBOT())
