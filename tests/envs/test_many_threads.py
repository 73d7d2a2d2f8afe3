"""Threads share the games and nothing else: game i of many is the game alone, bit for bit, whatever their number."""

from __future__ import annotations

import copy
import math
import os
from typing import Any

import numpy as np
import pytest

from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.game.ghosts import Behaviour
from pacman_env.policies.base import BasePolicy
from pacman_env.policies.registry import make_policy
from pacman_env.sim.observation.planner_features import planner_features
from pacman_env.sim.observation.situation import Situation
from tests.envs.cases import RANGES, SMALL
from tests.envs.helpers import joined, same

DECISIONS = int(os.environ.get("PACMAN_ENV_THREADS_DECISIONS", "60"))  # 1,000 for a release
N, COMPARED = 14, (0, 5, 13)


class Patrol(BasePolicy):
    """Sends its ghost to a place that time and seed tell."""

    name = "patrol"

    def select(self, situation: Situation) -> np.ndarray:
        return (situation.tick // 5 + (situation.seed % 7).astype(np.int64)) % situation.mask.shape[1]


CASES: dict[str, dict[str, Any]] = {
    "as built": {"settings": {"execution.rules": "as_built"}, "preset": "ideal"},
    "ghosts": {"ghosts": ("chase", "arcade", "wander", "chase")},
    "velocities": {"action": "velocity", "map": "maze"},
    "endless": {"settings": {"execution.pickup_radius_m": 3.0, "endless": True}},
    "randomised": {"settings": {**RANGES, "num_levels": 2}, "map": "generated"},
    "events, endless": {"settings": {"execution.pickup_radius_m": 3.0, "decisions.when": "event", "endless": True}},
    "events, policies": {
        "settings": {"decisions.when": "event", "num_levels": 3},
        "ghosts": ["chase", Patrol()],
        "map": "generated",
    },
}


def made(case: str, n: int, **more: Any) -> PacManBotVectorEnv:
    return PacManBotVectorEnv(n, **joined({"settings": SMALL}, copy.deepcopy(CASES[case]), more))


def row(data: Any, game: int) -> Any:
    """Return one game's part of a result."""
    if isinstance(data, dict):
        return {key: row(value, game) for key, value in data.items()}
    return data[game : game + 1]


def state(env: PacManBotVectorEnv, game: int) -> list[bytes]:
    """Return all that there is to know of a game, but for the slot that its map lies in."""
    record = env.batch.games[game : game + 1].copy()
    record["level"] = 0
    names = [name for name in vars(Situation)["__dataclass_fields__"] if name not in ("maps", "threads", "level")]
    seen = [getattr(env.situation, name)[game].tobytes() for name in names]
    return [record.tobytes(), env.batch.ghosts[game].tobytes(), env.batch.alive[game].tobytes(), *seen]


@pytest.mark.parametrize("case", CASES)
def test_game_in_batch_equals_single_game(case: str) -> None:
    together = [made(case, N, num_threads=number) for number in (1, 2, 7)]
    alone = {i: made(case, 1) for i in COMPARED}
    for env in together:
        env.reset(seed=100)
    for i, env in alone.items():
        env.reset(seed=100 + i)
    together[0].action_space.seed(3)
    ends = 0
    for k in range(DECISIONS):
        chosen = together[0].action_space.sample() if k % 4 == 0 else chosen  # noqa: F821
        results = [env.step(chosen) for env in together]
        assert same(results[0], results[1]), k
        assert same(results[0], results[2]), k
        ends += int((results[0][2] | results[0][3]).sum())
        for i, env in alone.items():
            for one, other in zip(env.step(chosen[i : i + 1]), results[0], strict=True):
                assert same(one, row(other, i)), (k, i)
            assert all(state(env, 0) == state(many, i) for many in together), (k, i)
    assert ends > 0 or "endless" in case


def test_planner_features_are_equal_with_threads() -> None:
    one, many = made("randomised", N), made("randomised", N, num_threads=7)
    for env in (one, many):
        env.reset(seed=0)
    for _ in range(10):
        features = [planner_features(env.situation, 0.3) for env in (one, many)]
        assert all(a.tobytes() == b.tobytes() for a, b in zip(*features, strict=True))
        chosen = [make_policy("lookahead").select(env.situation) for env in (one, many)]
        np.testing.assert_array_equal(*chosen)
        one.step(chosen[0])
        many.step(chosen[0])


def _homesick(view, parameters):  # type: ignore[no-untyped-def]
    if math.hypot(view.robot_x, view.robot_y) > parameters[0]:
        raise LookupError("the robot has gone")
    return view.robot_x, view.robot_y


HOMESICK = Behaviour("homesick", _homesick, (0.6,))


@pytest.mark.parametrize(
    ("threads", "ghosts"), [(1, [f"{__name__}:HOMESICK"]), (7, ["chase", Patrol(), f"{__name__}:HOMESICK"])]
)
def test_error_of_ghost_function_is_raised(threads: int, ghosts: list[Any]) -> None:
    settings = {"clyde.speed_mps": 0.0, "execution.death_radius_m": 1e-6}
    env, fresh = (PacManBotVectorEnv(N, num_threads=n, ghosts=ghosts, settings=settings) for n in (threads, 1))
    env.reset(seed=0)
    chosen = np.full(N, env.batch.hold)
    chosen[9] = np.where(env.situation.mask[9], env.situation.path_robot[9], 0.0).argmax()  # one robot leaves home

    def step_often() -> None:
        for _ in range(60):
            env.step(chosen)

    with pytest.raises(LookupError, match="the robot has gone"):
        step_often()
    assert same(env.reset(seed=4), fresh.reset(seed=4))
    for _ in range(5):
        assert same(env.step(np.full(N, env.batch.hold)), fresh.step(np.full(N, env.batch.hold)))


def test_threads_do_not_outnumber_games() -> None:
    assert [made("ghosts", n, num_threads=7).batch.threads.number for n in (1, 3, 9)] == [1, 3, 7]
    assert made("ghosts", 1, num_threads=0).batch.threads.number == 1
