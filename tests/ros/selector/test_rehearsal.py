"""A policy is rehearsed before the game."""

from collections.abc import Callable
from itertools import accumulate
from types import SimpleNamespace

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.levels.assets import map_assets
from pacman_env.levels.level import COARSE_MAP
from pacman_env.observations.robot_view import RobotView
from pacman_env.observations.situation import maps_of
from pacman_env.policies.registry import make_policy
from pacman_env.ros.selector.policy_child import rehearse


def test_rehearsal_prepares_map_that_predicts_chase() -> None:
    """Its kernels take half a minute to compile, in which a game would stand still."""
    config = make_config("robot")
    view = RobotView(map_assets("house", config), config)
    (level,) = maps_of(view.sample_situation()).levels(np.array([0]))
    assert level.find(COARSE_MAP) is None
    rehearse(make_policy("ppo"), view, config)
    assert level.find(COARSE_MAP) is not None


def ticking(first_s: float, later_s: float) -> Callable[[], float]:
    """Return a clock on which the first two choices take ``first_s`` and all others ``later_s``."""
    times_s = accumulate([0.0, first_s, 0.0, first_s, *[0.0, later_s] * 9])
    return lambda: next(times_s)


def test_policy_that_is_always_slow_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    config = make_config("robot")
    view, policy = RobotView(map_assets("house", config), config), make_policy("nearest")
    clock = SimpleNamespace(perf_counter=ticking(60.0, 0.5))
    monkeypatch.setattr("pacman_env.ros.selector.policy_child.time", clock)
    assert rehearse(policy, view, config) is policy
    clock.perf_counter = ticking(60.0, 3.0)
    with pytest.raises(ValueError, match="nearest"):
        rehearse(policy, view, config)
