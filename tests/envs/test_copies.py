"""Copies and restored states continue alike where the contract does not look: all ids, walls, threads, processes."""

import copy
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from pacman_env.config import Config
from pacman_env.envs.registration import FLAT_ID, IDS
from pacman_env.observations.planner_features import planner_features
from pacman_env.observations.situation import Situation
from tests.envs.adapters import fingerprint
from tests.envs.cases import SMALL
from tests.envs.helpers import make, make_vector, same
from tests.navigator_drives import deepest_contact


def copies(one: Any) -> list[Any]:
    return [copy.deepcopy(one), pickle.loads(pickle.dumps(one))]


@pytest.mark.parametrize(("source", "action"), [("maze", "goal"), ("generated", "velocity")])
def test_copies_of_later_endless_rounds_continue_alike(source: str, action: str) -> None:
    settings = {**SMALL, "execution.pickup_radius_m": 3.0, "execution.death_radius_m": 1e-6, "time_limit_s": 30.0}
    settings |= {"power.pellets": 2}
    ghosts = ("chase", "arcade")
    env = make_vector(3, map=source, action=action, ghosts=ghosts, settings={**settings, "endless": True})
    env.reset(seed=1)
    env.action_space.seed(0)
    for k in range(50):
        actions = env.action_space.sample() if k % 6 == 0 else actions  # noqa: F821
        rounds = env.step(actions)[4]["round"]
    assert (rounds > 1).any()
    assert len(set(rounds)) > 1  # the games are not in step
    twins = copies(env)
    for _ in range(40):
        expected = env.step(actions)
        assert all(same(twin.step(actions), expected) for twin in twins)
    assert all(same(twin.reset(), copy.deepcopy(env).reset()) for twin in twins)


@pytest.mark.parametrize("preset", ["robot", "ideal"])
def test_copies_of_robots_at_walls_continue_alike(preset: str) -> None:
    env = make_vector(6, map="maze", preset=preset, action="velocity", settings={"execution.death_radius_m": 1e-6})
    env.reset(seed=0)
    forwards = np.stack([np.full(6, env.config.robot.wheel_speed_mps), np.linspace(-0.3, 0.3, 6)], axis=1)
    for _ in range(4):
        for _ in range(15):
            env.step(forwards)
        twins = copies(env)
        for _ in range(15):
            before = env.batch.games[["x", "y"]].copy()
            result = env.step(forwards)
            assert all(same(twin.step(forwards), result) for twin in twins)
            assert all((twin.batch.games == env.batch.games).all() for twin in twins)
        travelled = np.hypot(env.batch.games["x"] - before["x"], env.batch.games["y"] - before["y"])
        assert deepest_contact(env.batch) > 0.0
    assert (travelled < 0.5 * 0.5 * forwards[0, 0]).any()  # half of what the wheels turn


def test_copied_situation_owns_its_memory() -> None:
    env = make_vector(4, map="generated", settings={**SMALL, "num_levels": 5}, num_threads=2)
    env.reset(seed=0)
    seen = env.situation
    before = planner_features(seen, 0.3)
    for twin in (copy.copy(seen), *copies(seen)):
        assert same(twin.arrays(), seen.arrays())
        assert all(a.tobytes() == b.tobytes() for a, b in zip(before, planner_features(twin, 0.3), strict=True))
    twin = copy.deepcopy(seen)
    twin.mask[:, 0] = False
    assert not twin.rows(slice(None)).mask[:, 0].any()
    assert planner_features(twin, 0.3)[0].tobytes() != before[0].tobytes()
    assert planner_features(seen, 0.3)[0].tobytes() == before[0].tobytes()


ROOT = Path(__file__).resolve().parents[2]


def rounds(env: Any, steps: int) -> list[Any]:
    """Return the results of random actions, each held for four steps."""
    env.action_space.seed(0)
    results = []
    for k in range(steps):
        actions = env.action_space.sample() if k % 4 == 0 else actions  # noqa: F821
        results.append(env.step(actions))
    return results


def shown(env: Any) -> list[Any]:
    """Return situations without the slots of maps, level numbers and masks."""
    masks = env.action_masks() if env.config.action == "goal" else None
    return [env.situation.arrays()[:-1], env.batch.level_numbers(), masks]


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("env_id", IDS)
def test_restored_states_repeat_whole_rounds(env_id: str, mode: str) -> None:
    made: dict[str, Any] = {"settings": {"time_limit_s": 20.0}, "autoreset_mode": mode}
    env, other = (gym.make_vec(env_id, 2, **made).unwrapped for _ in range(2))
    env.reset(seed=3)
    rounds(env, 9)
    state, seen = env.clone_state(), shown(env)
    expected = rounds(env, 70)
    assert sum((result[2] | result[3]).sum() for result in expected) >= 2
    for one in (env, other, other):
        one.restore_state(state)
        assert same(shown(one), seen)
        assert same(rounds(one, 70), expected)
    twins = copies(other)
    expected = [rounds(other, 20), other.reset()]
    assert all(same([rounds(twin, 20), twin.reset()], expected) for twin in twins)


def test_state_includes_episodes_and_settings_of_resets() -> None:
    env, other = make(settings=SMALL), make(settings=SMALL)
    env.reset(seed=1, options={"settings": {"clyde.speed_mps": 0.1}})
    rounds(env, 3)
    state = env.clone_state()
    expected = [*rounds(env, 3), env.reset()]
    for one in (env, other):
        one.restore_state(state)
        assert one.config.clyde.speed_mps == 0.1
        assert same([*rounds(one, 3), one.reset()], expected)


@pytest.mark.parametrize("threads", [(1, 2), (2, 1)])
def test_state_continues_with_other_number_of_threads(threads: tuple[int, int]) -> None:
    made: dict[str, Any] = {"map": "generated", "settings": {**SMALL, "num_levels": 9}, "autoreset_mode": "SameStep"}
    env, other = (make_vector(4, num_threads=number, max_episode_steps=7, **made) for number in threads)
    env.reset(seed=1)
    rounds(env, 20)
    other.restore_state(env.clone_state())
    expected = rounds(env, 40)
    assert sum((result[2] | result[3]).sum() for result in expected) > 16  # several episodes begin in each game
    assert same([rounds(other, 40), other.reset()], [expected, env.reset()])


class Drunkard:
    """Sends its ghost to random places; its generator is its state."""

    name = "drunkard"

    def __init__(self) -> None:
        self.rng = np.random.default_rng(0)

    def reset(self, games: np.ndarray, config: Config) -> None:
        self.rng.random()

    def select(self, situation: Situation) -> np.ndarray:
        return self.rng.integers(0, situation.mask.shape[1], len(situation))


def test_state_includes_policies_of_ghosts() -> None:
    policy = Drunkard()
    env = make_vector(3, ghosts=(policy, "arcade"), settings=SMALL, autoreset_mode="SameStep")
    env.reset(seed=1)
    rounds(env, 5)
    state, mine = env.clone_state(), policy.rng.bit_generator.state
    for _ in range(2):
        expected = rounds(env, 30)
        env.restore_state(state)
        assert same(rounds(env, 30), expected)
        env.restore_state(state)
    assert policy.rng.bit_generator.state != mine  # used by the environment until the first restore


def test_another_process_restores_state(tmp_path: Path) -> None:
    made = {"map": "generated", "ghosts": 2, "settings": {"num_levels": 0}}  # houses that are not cached
    env = gym.make_vec(FLAT_ID, 2, **made).unwrapped
    env.reset(seed=4)
    rounds(env, 5)
    (tmp_path / "state").write_bytes(pickle.dumps(env.clone_state()))
    code = f"""
import pickle, sys, gymnasium, pacman_env
from tests.envs.adapters import fingerprint
from tests.envs.test_copies import rounds
env = gymnasium.make_vec({FLAT_ID!r}, 2, **{made!r}).unwrapped
env.restore_state(pickle.load(open(sys.argv[1], "rb")))
print(fingerprint(rounds(env, 12)))
"""
    command = [sys.executable, "-c", code, str(tmp_path / "state")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == fingerprint(rounds(env, 12))


def test_restored_observation_stays_valid_without_copies() -> None:
    env = make_vector(2, copy=False, settings=SMALL)
    env.reset(seed=0)
    state = env.clone_state()
    last = env.step(np.zeros(2, dtype=np.int64))[0]
    kept = copy.deepcopy(last)
    env.restore_state(state)
    assert same(last, kept)


OTHERS: dict[str, tuple[Any, str]] = {
    "class": (lambda: make(settings=SMALL), "class = 'PacManBotEnv'"),
    "games": (lambda: make_vector(3, settings=SMALL), "num_envs = 3 instead of 2"),
    "map": (lambda: make_vector(2, map="loop", settings=SMALL), "map = 'loop"),
    "settings": (lambda: make_vector(2, settings={**SMALL, "clyde.speed_mps": 0.3}), "clyde.speed_mps = 0.3 instead"),
    "ghosts": (lambda: make_vector(2, settings=SMALL, ghosts=Drunkard()), "Drunkard"),
    "limit": (lambda: make_vector(2, settings=SMALL, max_episode_steps=9), "max_episode_steps = 9 instead of None"),
    "mode": (lambda: make_vector(2, settings=SMALL, autoreset_mode=AutoresetMode.SAME_STEP), "autoreset_mode"),
}


@pytest.mark.parametrize("other", OTHERS)
def test_state_of_other_environment_is_refused(other: str) -> None:
    make_other, words = OTHERS[other]
    env, one = make_vector(2, settings=SMALL), make_other()
    with pytest.raises(gym.error.ResetNeeded):
        one.clone_state()
    env.reset(seed=0)
    one.reset(seed=1)
    twin = copy.deepcopy(env)
    with pytest.raises(ValueError, match=words):
        env.restore_state(one.clone_state())
    with pytest.raises(ValueError, match="clone_state"):
        env.restore_state(one)
    assert same(rounds(env, 4), rounds(twin, 4))


def test_state_of_other_version_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    env = make(settings=SMALL)
    with monkeypatch.context() as earlier:
        earlier.setattr("pacman_env.envs.base_env.__version__", "0.1.0")
        old = make(settings=SMALL)
        old.reset()
        state = old.clone_state()
    with pytest.raises(ValueError, match=r"version = '0\.1\.0'"):
        env.restore_state(state)
