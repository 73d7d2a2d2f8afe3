"""Checkers of Gymnasium, Stable-Baselines3, sb3-contrib and PettingZoo find no fault.

They see environments of which any two arguments meet, every registered id, every shipped map and the shapes that stock
learners take. A warning of a checker is an error, but for those named in ``ALLOWED``.
"""

import types
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pettingzoo
import pytest
from gymnasium.utils.env_checker import check_env

import pacman_env
from pacman_env.envs.registration import IDS
from pacman_env.render import window as screen
from pacman_env.sb3 import PacManBotVecEnv
from pacman_env.world.maps.occupancy import shipped_maps
from tests.envs.cases import AXES, LEARNERS, PAIRWISE, SEVERAL_LEARNERS, SMALL, arguments, name, pairwise
from tests.envs.helpers import ID, make

with warnings.catch_warnings():
    # PettingZoo's tests import its own environments in its old way.
    warnings.filterwarnings("ignore", "The old environment creation API has been deprecated", DeprecationWarning)
    from pettingzoo.test import (
        api_test,
        max_cycles_test,
        parallel_api_test,
        parallel_seed_test,
        render_test,
        seed_test,
        state_test,
    )

#: What checkers may warn of, each with the reason why it stays.
ALLOWED = {
    # Velocities are m/s and rad/s, as the robot's cmd_vel takes them, and it drives forwards only.
    ".*For Box action spaces, we recommend using a symmetric and normalized space",
    "We recommend you to use a symmetric and normalized Box action space",
    # A row per candidate, pellet or ghost: a network looks at each with the same weights.
    "Your observation (candidates|ghosts|\\w+_(bearings|power)) has an unconventional shape",
    # Observations are dictionaries, as in Gymnasium: a mask beside features, a scan, a picture.
    "Observation is not a NumPy array",
    "Observation space for each agent probably should be",
    # The four ghosts have had names since 1980.
    "We recommend agents to be named in the format",
    # Pac-Man alone has a lidar and a camera, and with velocity actions no mask.
    "Agents have different observation space sizes",
}
pytestmark = [pytest.mark.filterwarnings(f"ignore:{message}:UserWarning") for message in sorted(ALLOWED)]
HAS_REGISTRY = hasattr(pettingzoo, "register")  # PettingZoo before 1.27 has none
Maker = Callable[..., Any]
SINGLES: dict[str, Maker] = {
    **{name(row): partial(make, **arguments(row)) for row in PAIRWISE},
    **{source: partial(make, map=source) for source in shipped_maps()},
    **{shape: partial(make, **chosen) for shape, chosen in LEARNERS.items()},
    **{env_id: partial(gym.make, env_id) for env_id in IDS},
}


def both(several: dict[str, Any]) -> tuple[Maker, Maker]:
    return partial(pacman_env.parallel_env, **several), partial(pacman_env.env, **several)


#: Parallel and agent-by-agent environments; episodes end within the checkers' patience, in more ways than one.
SEVERAL: dict[str, tuple[Maker, Maker]] = {
    name(row): both(arguments(row, several=True, zero_sum=row["zero_sum"]))
    for row in pairwise({**AXES, "zero_sum": (True, False)})
}
SEVERAL |= {shape: both({"map": "loop", **chosen}) for shape, chosen in SEVERAL_LEARNERS.items()}
SEVERAL |= {
    env_id: tuple(
        partial(pettingzoo.make, kind, env_id, settings={"time_limit_s": 6.0}) for kind in ("parallel", "aec")
    )
    for env_id, entry in IDS.items()
    if entry.several is not None and HAS_REGISTRY
}  # type: ignore[misc]


@pytest.fixture(autouse=True)
def _quick_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(screen, "RENDER_FPS", 10_000)  # nobody watches


@pytest.mark.parametrize("chosen", SINGLES)
def test_gymnasium_and_sb3_checkers_find_no_fault(chosen: str) -> None:
    from stable_baselines3.common.env_checker import check_env as check_for_sb3

    env = SINGLES[chosen](render_mode="rgb_array").unwrapped
    check_env(env, skip_render_check=not chosen.startswith("pacman_env"))
    check_for_sb3(env, skip_render_check=False)


@pytest.mark.parametrize("action", ["goal", "velocity"])
def test_sb3_contrib_finds_masks_for_goal_actions_only(action: str) -> None:
    from sb3_contrib.common.maskable.utils import get_action_masks, is_masking_supported
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import DummyVecEnv

    chosen: dict[str, Any] = {"action": action, "settings": SMALL}
    for env in (
        make(**chosen),
        gym.make(ID, **chosen),
        DummyVecEnv([lambda: Monitor(gym.make(ID, **chosen))] * 2),
        PacManBotVecEnv(2, **chosen),
    ):
        assert is_masking_supported(env) == (action == "goal")
        if action == "goal":
            started = env.reset()
            observation = started[0] if isinstance(started, tuple) else started
            np.testing.assert_array_equal(get_action_masks(env), observation["action_mask"] == 1)


@pytest.mark.parametrize("chosen", SEVERAL)
def test_pettingzoo_tests_find_no_fault(chosen: str) -> None:
    parallel, turns = SEVERAL[chosen]
    parallel_api_test(parallel(), num_cycles=30)
    api_test(turns(), num_cycles=30)
    parallel_seed_test(parallel, num_cycles=10)
    seed_test(turns, num_cycles=10)
    if isinstance(parallel, partial) and parallel.func is not pettingzoo.make:
        state_test(turns(), parallel())


def test_max_cycles_are_obeyed_in_both_interfaces() -> None:
    def limited(make: Any) -> Any:
        return lambda max_cycles: make(settings={"max_cycles": max_cycles})

    max_cycles_test(types.SimpleNamespace(env=limited(pacman_env.env), parallel_env=limited(pacman_env.parallel_env)))


def test_pettingzoo_render_test_passes() -> None:
    pytest.importorskip("pygame")
    render_test(lambda **mode: pacman_env.env(ghosts=("policy", "chase"), **mode))
