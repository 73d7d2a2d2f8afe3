"""Threads share the games and nothing else: game i of many is the game alone, bit for bit, whatever their number."""

from __future__ import annotations

import copy
import math
import os
import pickle
from typing import Any, NamedTuple

import numpy as np
import pytest

from pacman_env.engine.arrays import Array, Table
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.game.ghosts import Behaviour
from pacman_env.policies.base import BasePolicy
from pacman_env.policies.registry import make_policy
from pacman_env.sim.observation.planner_features import planner_features
from pacman_env.sim.observation.situation import Situation
from tests.envs.configurations import RANGES, SMALL
from tests.envs.helpers import joined, same

DECISIONS = int(os.environ.get("PACMAN_ENV_THREADS_DECISIONS", "60"))  # 1,000 for the contract
N, COMPARED = 14, (0, 5, 13)


class Patrol(BasePolicy):
    """Sends its ghost to a place that time and seed tell."""

    name = "patrol"

    def select(self, situation: Situation) -> np.ndarray:
        places = situation.mask.shape[1]
        return (situation.tick // 5 + (situation.seed % 7).astype(np.int64)) % places


CASES: dict[str, dict[str, Any]] = {
    "one map": {},
    "as built": {"settings": {"execution.rules": "as_built"}, "preset": "ideal"},
    "houses": {"map": "generated", "settings": {"num_levels": 5}},
    "ghosts": {"ghosts": ("chase", "arcade", "wander", "chase")},
    "policies": {"ghosts": ["wander", Patrol()]},
    "velocities": {"action": "velocity", "map": "maze"},
    "endless": {"settings": {"execution.pickup_radius_m": 3.0, "endless": True}},
    "randomised": {"settings": {**RANGES, "num_levels": 2}, "map": "generated"},
    "events": {"settings": {"decisions.when": "event"}, "ghosts": ("arcade", "wander")},
    "events, endless": {"settings": {"execution.pickup_radius_m": 3.0, "decisions.when": "event", "endless": True}},
    "events, policies": {
        "settings": {"decisions.when": "event", "num_levels": 3},
        "ghosts": ["chase", Patrol()],
        "map": "generated",
    },
}
all_cases = pytest.mark.parametrize("case", CASES)


def made(case: str, n: int, **more: Any) -> PacManBotVectorEnv:
    return PacManBotVectorEnv(n, **joined({"settings": SMALL}, copy.deepcopy(CASES[case]), more))


def actions(env: PacManBotVectorEnv, decisions: int, n: int, seed: int = 3) -> np.ndarray:
    """(T, n) random ones, each kept for a while."""
    rng = np.random.default_rng(seed)
    space = env.single_action_space
    if env.config.action == "velocity":
        drawn = rng.uniform(space.low, space.high, (decisions // 4 + 1, n, 2))  # type: ignore[union-attr]
    else:
        drawn = rng.integers(0, space.n, (decisions // 4 + 1, n))  # type: ignore[union-attr]
    return drawn.repeat(4, axis=0)[:decisions]


def row(data: Any, game: int) -> Any:
    """One game's part of a result."""
    if isinstance(data, dict):
        return {key: row(value, game) for key, value in data.items()}
    return data[game : game + 1]


def state(env: PacManBotVectorEnv, game: int) -> list[bytes]:
    """All that there is to know of a game, but for the slot that its map lies in."""
    record = env.batch.games[game : game + 1].copy()
    record["level"] = 0
    names = [name for name in vars(Situation)["__dataclass_fields__"] if name not in ("maps", "threads", "level")]
    seen = [getattr(env.situation, name)[game].tobytes() for name in names]
    return [record.tobytes(), env.batch.ghosts[game].tobytes(), env.batch.alive[game].tobytes(), *seen]


@all_cases
def test_game_i_of_many_is_the_game_alone_for_any_number_of_threads(case: str) -> None:
    together = [made(case, N, num_threads=number) for number in (1, 2, 7)]
    alone = {i: made(case, 1) for i in COMPARED}
    for env in together:
        env.reset(seed=100)
    for i, env in alone.items():
        env.reset(seed=100 + i)
    ends = 0
    for k, chosen in enumerate(actions(together[0], DECISIONS, N)):
        results = [env.step(chosen) for env in together]
        assert same(results[0], results[1]), k
        assert same(results[0], results[2]), k
        ends += int((results[0][2] | results[0][3]).sum())
        for i, env in alone.items():
            found = env.step(chosen[i : i + 1])
            for one, other in zip(found, results[0], strict=True):
                assert same(one, row(other, i)), (k, i)
            assert all(state(env, 0) == state(many, i) for many in together), (k, i)
    assert ends > 0 or "endless" in case


@pytest.mark.parametrize("threads", [1, 7])
def test_what_a_planner_sees_is_the_same_for_any_number_of_threads(threads: int) -> None:
    one, many = made("houses", N), made("houses", N, num_threads=threads)
    for env in (one, many):
        env.reset(seed=0)
    chooser = make_policy("lookahead")
    for _ in range(10):
        for expected, found in zip(
            planner_features(one.situation, 0.3), planner_features(many.situation, 0.3), strict=True
        ):
            assert expected.tobytes() == found.tobytes()
        chosen = chooser.select(one.situation)
        np.testing.assert_array_equal(make_policy("lookahead").select(many.situation), chosen)
        one.step(chosen)
        many.step(chosen)


@all_cases
def test_copies_in_the_middle_of_episodes_go_on_alike(case: str) -> None:
    env = made(case, 6, num_threads=3)
    env.reset(seed=0)
    chosen = actions(env, 40, 6)
    for now in chosen[:17]:
        env.step(now)
    twins = [copy.deepcopy(env), pickle.loads(pickle.dumps(env)), made(case, 6, num_threads=1)]
    twins[2].reset(seed=0)
    for now in chosen[:17]:
        twins[2].step(now)
    assert [twin.batch.threads.number for twin in twins] == [3, 3, 1]
    for now in chosen[17:]:
        expected = env.step(now)
        assert all(same(expected, twin.step(now)) for twin in twins)


def test_a_copied_situation_is_of_one_memory() -> None:
    env = made("houses", 4, num_threads=2)
    env.reset(seed=0)
    seen = env.situation
    before = planner_features(seen, 0.3)
    for twin in (copy.copy(seen), copy.deepcopy(seen), pickle.loads(pickle.dumps(seen))):
        assert same(twin.arrays(), seen.arrays())
        assert all(a.tobytes() == b.tobytes() for a, b in zip(before, planner_features(twin, 0.3), strict=True))
    twin = copy.deepcopy(seen)
    twin.mask[:, 0] = False
    assert not twin.rows(slice(None)).mask[:, 0].any()
    changed = planner_features(twin, 0.3)
    assert changed[0].tobytes() != before[0].tobytes()
    assert planner_features(seen, 0.3)[0].tobytes() == before[0].tobytes()


def _homesick(view, parameters):  # type: ignore[no-untyped-def]
    if math.hypot(view.robot_x, view.robot_y) > parameters[0]:
        raise LookupError("the robot has gone")
    return view.robot_x, view.robot_y


def step_often(env: PacManBotVectorEnv, chosen: np.ndarray) -> None:
    for _ in range(60):
        env.step(chosen)


HOMESICK = Behaviour("homesick", _homesick, (0.6,))


@pytest.mark.parametrize("number", [1, 2, 7])
@pytest.mark.parametrize("ghosts", [("homesick",), ("chase", "wander", "homesick"), ("policy", "homesick")])
@pytest.mark.parametrize("decide", ["tick", "event"])
def test_what_a_ghosts_function_raises_arrives(number: int, ghosts: tuple[str, ...], decide: str) -> None:
    known = {"homesick": f"{__name__}:HOMESICK", "policy": Patrol()}
    arguments: dict[str, Any] = {
        "ghosts": [known.get(one, one) for one in ghosts],
        "settings": {"decisions.when": decide},
    }
    arguments["settings"] = {"clyde.speed_mps": 0.0, "execution.death_radius_m": 1e-6}
    env = PacManBotVectorEnv(N, num_threads=number, **copy.deepcopy(arguments))
    env.reset(seed=0)
    chosen = np.full(N, env.batch.hold)
    way = np.where(env.situation.mask[9], env.situation.path_robot[9], 0.0)
    chosen[9] = way.argmax()  # one game's robot leaves home
    with pytest.raises(LookupError, match="the robot has gone"):
        step_often(env, chosen)
    fresh = PacManBotVectorEnv(N, **copy.deepcopy(arguments))
    assert same(env.reset(seed=4), fresh.reset(seed=4))
    for _ in range(5):
        assert same(env.step(np.full(N, env.batch.hold)), fresh.step(np.full(N, env.batch.hold)))


def test_there_are_no_more_threads_than_games() -> None:
    assert [made("one map", n, num_threads=7).batch.threads.number for n in (1, 3, 9)] == [1, 3, 7]
    assert made("one map", 1, num_threads=0).batch.threads.number == 1


def test_tables_refuse_arrays_that_kernels_would_misread() -> None:
    class Pair(NamedTuple):
        first: Any = Array(np.float64, "2 N")
        second: Any = Array(np.int32, "N")

    first, second = np.zeros((2, 4)), np.zeros(4, np.int32)
    assert list(Table(Pair, second=second, first=first).numbers[1:3]) == [2, 4]
    bad = [np.zeros((2, 2), np.float32), np.zeros(2), np.zeros((4, 8))[::2, ::2], np.zeros((4, 2)).T, np.zeros((3, 4))]
    for array in bad:
        with pytest.raises(TypeError, match=r"Pair.first: must be float64 of shape \(2, N\), C-contiguous"):
            Table(Pair, first=array, second=second)
    with pytest.raises(TypeError, match=r"Pair\.second"):
        Table(Pair, first=first, second=second[1:].copy())
    with pytest.raises(TypeError, match=r"missing arrays \['second'\], unknown arrays \['third'\]"):
        Table(Pair, first=first, third=second)
