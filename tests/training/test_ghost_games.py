"""Clyde's games are the PettingZoo environment's, and are what Stable-Baselines3 expects."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

pytest.importorskip("sb3_contrib")

import dataclasses

import gymnasium as gym
from stable_baselines3.common.vec_env import DummyVecEnv

import pacman_env
from pacman_env.envs.pettingzoo_env import PACMAN, PacManBotParallelEnv
from pacman_env.policies.registry import make_policy
from pacman_env.sim.observation.planner_features import planner_features
from pacman_env.training.arguments import FOLDER, Arguments, load_hyperparameters
from pacman_env.training.games import game_settings
from pacman_env.training.ghost_games import CLYDE, ghost_games, make_ghost_games

GAMES, SCALE = 3, 0.5
HYPER = dataclasses.replace(
    load_hyperparameters(FOLDER / "PacManBot-v0.yaml", "headline"),
    games=GAMES,
    segment=GAMES * 64,
    levels=2 * GAMES,
    reward_scale=SCALE,
)
ARGUMENTS = Arguments(hyper=HYPER)
ROBOT = partial(make_policy, "nearest")


def quick(**changes: Any) -> PacManBotParallelEnv:
    """An environment whose rounds are over soon."""
    return pacman_env.parallel_env(**({"map": "house", "settings": {"time_limit_s": 6.0}} | changes))


def begun(envs: list[PacManBotParallelEnv], seed: int = 5) -> DummyVecEnv:
    games = ghost_games(envs, ROBOT)
    games.seed(seed)
    games.reset()
    return games


def test_every_game_is_the_environment_with_the_policy_in_the_robots_seat() -> None:
    games = begun([quick() for _ in range(GAMES)])
    twins, robots = [quick() for _ in range(GAMES)], [ROBOT() for _ in range(GAMES)]
    for i, twin in enumerate(twins):
        twin.reset(5 + i)
    rng = np.random.default_rng(0)
    ends = 0
    for _ in range(30):
        choices = rng.integers(games.action_space.n, size=GAMES)  # type: ignore[attr-defined]
        observations, rewards, dones, infos = games.step(choices)
        for i, (twin, robot) in enumerate(zip(twins, robots, strict=True)):
            goal = robot.select(twin.batch.situation())[0]
            _, reward, _, truncated, info = twin.step({PACMAN: goal, CLYDE: choices[i]})
            assert rewards[i] == np.float32(-reward[PACMAN])
            assert dones[i] == (not twin.agents)
            assert infos[i]["outcome"] == info[CLYDE]["outcome"]
            seen = planner_features(twin.batch.situation(0), twin.config.robot.speed_mps)
            if dones[i]:
                ends += 1
                np.testing.assert_array_equal(infos[i]["terminal_observation"]["planner_candidates"], seen[0][0])
                assert infos[i]["TimeLimit.truncated"] == truncated[CLYDE]
                twin.reset()
                seen = planner_features(twin.batch.situation(0), twin.config.robot.speed_mps)
            np.testing.assert_array_equal(observations["planner_candidates"][i], seen[0][0])  # type: ignore[index]
            np.testing.assert_array_equal(observations["planner_globals"][i], seen[1][0])  # type: ignore[index]
            mask = twin.batch.situation(0).mask[0]
            np.testing.assert_array_equal(observations["action_mask"][i], mask)  # type: ignore[index]
            np.testing.assert_array_equal(games.env_method("action_masks", indices=i)[0], mask)
    assert ends >= 2 * GAMES


def test_observations_are_in_the_space_and_not_reused() -> None:
    games = begun([quick() for _ in range(2)])
    first = games.step(np.zeros(2, dtype=np.int64))[0]
    copy = {key: array.copy() for key, array in first.items()}  # type: ignore[union-attr]
    games.step(np.ones(2, dtype=np.int64))
    for key, array in copy.items():
        np.testing.assert_array_equal(first[key], array)  # type: ignore[index]
    for i in range(2):
        assert games.observation_space.contains({key: array[i] for key, array in copy.items()})


def test_training_games_are_zero_sum_scaled_and_end_at_the_time_limit() -> None:
    games = make_ghost_games(ARGUMENTS, 0, ROBOT)
    world: DummyVecEnv = games.venv  # type: ignore[assignment]
    for env in world.envs:
        env.game._core.config = env.game.config.with_fields(max_cycles=12)  # type: ignore[attr-defined]
    paid: list[float] = []
    step = PacManBotParallelEnv.step

    class Paid(PacManBotParallelEnv):
        def step(self, actions: dict[str, Any]) -> Any:
            result = step(self, actions)
            paid.append(result[1][PACMAN])
            return result

    for env in world.envs:
        env.game.__class__ = Paid  # type: ignore[attr-defined]
    games.seed(0)
    games.reset()
    truncated = 0
    for _ in range(26):
        paid.clear()
        _, rewards, dones, infos = games.step(np.full(GAMES, games.action_space.n - 1))  # type: ignore[attr-defined]
        np.testing.assert_allclose(rewards, -SCALE * np.array(paid), rtol=1e-6)
        truncated += int(sum(info["outcome"] == "running" for info, done in zip(infos, dones, strict=True) if done))
        assert not any(info["TimeLimit.truncated"] for info in infos)
    assert truncated > 0


def test_each_game_has_houses_of_its_own_and_each_segment_others() -> None:
    def levels(segment: int) -> list[tuple[int, int]]:
        world: DummyVecEnv = make_ghost_games(ARGUMENTS, segment, ROBOT).venv  # type: ignore[assignment]
        return [(env.game.batch.source.start_level, env.game.batch.source.num_levels) for env in world.envs]  # type: ignore[attr-defined]

    assert levels(0) == [(0, 2), (2, 2), (4, 2)]
    assert levels(1) == [(6, 2), (8, 2), (10, 2)]


def test_the_game_is_the_one_the_planner_is_trained_on() -> None:
    world: DummyVecEnv = make_ghost_games(ARGUMENTS, 0, ROBOT).venv  # type: ignore[assignment]
    for name in ("clyde_speed_mps", "speed_mps"):
        assert getattr(world.envs[0].game.config.randomize, name) == game_settings(ARGUMENTS)[f"randomize.{name}"]


def test_the_same_seed_gives_the_same_bits() -> None:
    def play(seed: int) -> bytes:
        games = begun([quick() for _ in range(2)], seed)
        rng = np.random.default_rng(1)
        seen = b""
        for _ in range(20):
            observations, rewards, _, _ = games.step(rng.integers(games.action_space.n, size=2))  # type: ignore[attr-defined]
            seen += rewards.tobytes() + observations["planner_candidates"].tobytes()  # type: ignore[index,call-overload]
        return seen

    assert play(3) == play(3)
    assert play(3) != play(4)


def test_masks_and_attributes_are_found_by_the_names_that_are_asked_for() -> None:
    games = begun([quick() for _ in range(2)])
    assert games.has_attr("action_masks")
    assert not games.has_attr("no_such_thing")
    assert [game.config.zero_sum for game in games.get_attr("game")] == [True, True]
    games.set_attr("render_mode", "ansi", indices=1)
    assert games.get_attr("render_mode") == [None, "ansi"]
    assert len(games.env_method("action_masks")) == 2
    assert games.env_is_wrapped(gym.Wrapper) == [False, False]
    games.close()


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
        ghost_games([quick(**changes) for changes in envs], ROBOT)
