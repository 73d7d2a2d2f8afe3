"""Outside judges find no fault in any combination of the typed arguments.

The axes are observation (7: every choice of features, scan and grid), action (2), ghosts (3: one, a chasing and an
arcade one, four), endless (2), map (3, one of them generated), preset (2), execution (2) and every field randomized or
none (2): 2,016 combinations. Gymnasium's ``check_env`` sees all 84 of observation x action x ghosts x endless and, over
those and the rest, any three values together; its render check and the other judges see any two values together, for
the vector environment Gymnasium's three autoreset modes being one more axis.

A warning of a judge is an error, but for those named in ``ALLOWED``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.env_match import check_environments_match
from gymnasium.vector import SyncVectorEnv

from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.render import window as screen
from pacman_env.sb3 import PacManBotVecEnv
from pacman_env.world.maps.occupancy import shipped_maps
from tests.envs.configurations import AXES, COVERING, CROSSED, PAIRWISE, arguments, groups, name, product
from tests.envs.helpers import ID, make, make_vector, same

#: What judges may warn of, each with the reason why it stays.
ALLOWED = {
    # Velocities are m/s and rad/s, as the robot's cmd_vel takes them, and it drives forwards only.
    ".*For Box action spaces, we recommend using a symmetric and normalized space",
    "We recommend you to use a symmetric and normalized Box action space",
    # A row per candidate, pellet or ghost: a network looks at each with the same weights.
    "Your observation (candidates|ghosts|pellet_bearings|ghost_bearings) has an unconventional shape",
}
pytestmark = [pytest.mark.filterwarnings(f"ignore:{message}:UserWarning") for message in sorted(ALLOWED)]

judged = pytest.mark.parametrize("combination", PAIRWISE, ids=name)


@pytest.fixture(autouse=True)
def _quick_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(screen, "RENDER_FPS", 10_000)  # nobody watches


def test_the_combinations_are_those_promised() -> None:
    for combinations, strength in ((PAIRWISE, 2), (COVERING, 3)):
        met = {group for combination in combinations for group in groups(combination, strength)}
        assert met >= {group for combination in product(AXES) for group in groups(combination, strength)}
    crossed = {tuple(combination[axis] for axis in CROSSED) for combination in COVERING}
    assert len(crossed) == 7 * 2 * 3 * 2


@pytest.mark.parametrize("combination", COVERING, ids=name)
def test_gymnasium_finds_no_fault(combination: dict[str, Any]) -> None:
    check_env(make(**arguments(combination)), skip_render_check=True)


@pytest.mark.parametrize("name", shipped_maps())
def test_gymnasium_finds_no_fault_in_a_map_as_it_is_shipped(name: str) -> None:
    check_env(make(map=name, render_mode="rgb_array"))


@judged
def test_gymnasium_finds_no_fault_in_pictures(combination: dict[str, Any]) -> None:
    check_env(make(render_mode="rgb_array", **arguments(combination)))


@judged
def test_the_bare_and_the_made_environment_match(combination: dict[str, Any]) -> None:
    chosen = arguments(combination)
    check_environments_match(PacManBotEnv(**chosen), gym.make(ID, **chosen), num_steps=60, seed=3)


@judged
def test_the_native_vector_equals_one_of_single_environments(combination: dict[str, Any]) -> None:
    mode, chosen = combination["autoreset_mode"], arguments(combination, time_limit_s=4.0)
    native = make_vector(3, autoreset_mode=mode, **chosen)
    singles = SyncVectorEnv([lambda: gym.make(ID, **chosen)] * 3, autoreset_mode=mode)
    assert native.observation_space == singles.observation_space
    assert native.action_space == singles.action_space
    native.action_space.seed(1)
    assert same(native.reset(seed=5), singles.reset(seed=5))
    ends = 0
    for k in range(30):
        actions = native.action_space.sample()
        ours, theirs = native.step(actions), singles.step(actions)
        assert same(ours, theirs), k
        over = ours[2] | ours[3]
        ends += int(over.sum())
        if mode == gym.vector.AutoresetMode.DISABLED and over.any():
            both = [env.reset(options={"reset_mask": over.copy()}) for env in (native, singles)]
            assert same(*both), k
    assert ends > 3


@judged
def test_stable_baselines_finds_no_fault(combination: dict[str, Any]) -> None:
    from stable_baselines3.common.env_checker import check_env as check_for_sb3

    check_for_sb3(make(render_mode="rgb_array", **arguments(combination)), skip_render_check=False)


@judged
def test_sb3_contrib_finds_masks_where_actions_are_goals(combination: dict[str, Any]) -> None:
    from sb3_contrib.common.maskable.utils import get_action_masks, is_masking_supported
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import DummyVecEnv

    chosen = arguments(combination)
    builders: list[Callable[[], Any]] = [
        lambda: make(**chosen),
        lambda: gym.make(ID, **chosen),
        lambda: DummyVecEnv([lambda: Monitor(gym.make(ID, **chosen))] * 2),
        lambda: PacManBotVecEnv(2, **chosen),
    ]
    for build in builders:
        env = build()
        assert is_masking_supported(env) == (combination["action"] == "goal")
        if combination["action"] == "goal":
            started = env.reset()
            observation = started[0] if isinstance(started, tuple) else started
            np.testing.assert_array_equal(get_action_masks(env), observation["action_mask"] == 1)
        env.close()


def test_make_vec_of_every_mode_of_vectorization_makes_the_same_games() -> None:
    native = gym.make_vec(ID, num_envs=2, vectorization_mode="vector_entry_point")
    assert isinstance(native.unwrapped, PacManBotVectorEnv)
    singles = gym.make_vec(ID, num_envs=2, vectorization_mode="sync")
    assert same(native.reset(seed=1), singles.reset(seed=1))
