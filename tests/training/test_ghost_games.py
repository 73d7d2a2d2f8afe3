"""Clyde's games are the PettingZoo environment's."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import Any

import numpy as np
import pytest

pytest.importorskip("sb3_contrib")

import pacman_env
from pacman_env.envs.pettingzoo_env import PACMAN, PacManBotParallelEnv
from pacman_env.policies.registry import make_policy
from pacman_env.sim.observation.planner_features import planner_features
from pacman_env.training.arguments import FOLDER, Arguments, load_hyperparameters
from pacman_env.training.games import CLYDE, GhostGames, Step, game_settings, make_ghost_games

GAMES, SCALE = 3, 0.5
HYPER = dataclasses.replace(
    load_hyperparameters(FOLDER / "PacManBot-v0.yaml", "headline"),
    games=GAMES,
    segment=GAMES * 64,
    levels=2 * GAMES,
    reward_scale=SCALE,
    timeout=-5.0,
    ghosts=("wander",),
)
ARGUMENTS = Arguments(hyper=HYPER)
ROBOT = partial(make_policy, "nearest")


def quick(**changes: Any) -> PacManBotParallelEnv:
    """An environment whose rounds are over soon."""
    return pacman_env.parallel_env(**({"map": "house", "settings": {"time_limit_s": 6.0}} | changes))


def begun(envs: list[PacManBotParallelEnv], seed: int = 5) -> GhostGames:
    games = GhostGames(envs, ROBOT)
    games.reset(seed)
    return games


def step(games: GhostGames, choices: np.ndarray) -> Step:
    games.send(0, choices)
    return games.receive(0)


def count(games: GhostGames) -> int:
    return games.games[0].batch.candidates


def test_every_game_is_the_environment_in_which_the_policy_drives_the_robot() -> None:
    games = begun([quick() for _ in range(GAMES)])
    twins, robots = [quick() for _ in range(GAMES)], [ROBOT() for _ in range(GAMES)]
    for i, twin in enumerate(twins):
        twin.reset(5 + i)
    rng = np.random.default_rng(0)
    ends = 0
    for _ in range(30):
        choices = rng.integers(count(games), size=GAMES)
        observations, rewards, dones, infos = step(games, choices)
        for i, (twin, robot) in enumerate(zip(twins, robots, strict=True)):
            goal = robot.select(twin.batch.situation())[0]
            _, reward, _, _, info = twin.step({PACMAN: goal, CLYDE: choices[i]})
            assert rewards[i] == np.float32(-reward[PACMAN])
            assert dones[i] == (not twin.agents)
            assert infos[i]["outcome"] == info[CLYDE]["outcome"]
            if dones[i]:
                ends += 1
                twin.reset()
            seen = planner_features(twin.batch.situation(0), twin.config.robot.speed_mps)
            np.testing.assert_array_equal(observations["planner_candidates"][i], seen[0][0])
            np.testing.assert_array_equal(observations["planner_globals"][i], seen[1][0])
            np.testing.assert_array_equal(observations["action_mask"][i], twin.batch.situation(0).mask[0])
    assert ends >= 2 * GAMES


def test_observations_are_not_reused() -> None:
    games = begun([quick() for _ in range(2)])
    first = step(games, np.zeros(2, dtype=np.int64))[0]
    copy = {key: array.copy() for key, array in first.items()}
    step(games, np.ones(2, dtype=np.int64))
    for key, array in copy.items():
        np.testing.assert_array_equal(first[key], array)


def test_training_games_are_zero_sum_scaled_and_end_at_the_time_limit() -> None:
    games = make_ghost_games(ARGUMENTS, 0, ROBOT)
    paid: list[float] = []
    original = PacManBotParallelEnv.step

    class Paid(PacManBotParallelEnv):
        def step(self, actions: dict[str, Any]) -> Any:
            result = original(self, actions)
            paid.append(result[1][PACMAN])
            return result

    for game in games.games:
        game._core.config = game.config.with_fields(max_cycles=12)
        game.__class__ = Paid
    games.reset(0)
    truncated = 0
    for _ in range(26):
        paid.clear()
        _, rewards, dones, infos = step(games, np.full(GAMES, count(games) - 1))
        np.testing.assert_allclose(rewards, -SCALE * np.array(paid), rtol=1e-6)
        truncated += int(sum(info["outcome"] == "running" for info, done in zip(infos, dones, strict=True) if done))
    assert truncated > 0


def test_each_game_has_houses_of_its_own_and_each_segment_others() -> None:
    def levels(segment: int) -> list[tuple[int, int]]:
        sources: list[Any] = [game.batch.source for game in make_ghost_games(ARGUMENTS, segment, ROBOT).games]
        return [(source.start_level, source.num_levels) for source in sources]

    assert levels(0) == [(0, 2), (2, 2), (4, 2)]
    assert levels(1) == [(6, 2), (8, 2), (10, 2)]


def test_the_game_is_the_one_the_planner_is_trained_on() -> None:
    game = make_ghost_games(ARGUMENTS, 0, ROBOT).games[0]
    for name in ("clyde_speed_mps", "speed_mps"):
        assert getattr(game.config.randomize, name) == game_settings(ARGUMENTS)[f"randomize.{name}"]


def test_the_same_seed_gives_the_same_bits() -> None:
    def play(seed: int) -> bytes:
        games = begun([quick() for _ in range(2)], seed)
        rng = np.random.default_rng(1)
        seen = b""
        for _ in range(20):
            observations, rewards, _, _ = step(games, rng.integers(count(games), size=2))
            seen += rewards.tobytes() + observations["planner_candidates"].tobytes()
        return seen

    assert play(3) == play(3)
    assert play(3) != play(4)


@pytest.mark.parametrize(
    "envs",
    [
        [],
        [{}, {"map": "loop"}],
        [{"ghosts": ("policy", "policy")}],
        [{"ghosts": ("wander", "policy")}],
    ],
    ids=["none", "other maps", "two agents", "not clyde"],
)
def test_games_that_do_not_fit_are_refused(envs: list[dict[str, Any]]) -> None:
    with pytest.raises(ValueError, match="agents and candidates of the games"):
        GhostGames([quick(**changes) for changes in envs], ROBOT)
