"""A policy is rehearsed before the game."""

import numpy as np

from pacman_env.config import make_config
from pacman_env.policies.registry import make_policy
from pacman_env.ros.selector.rehearsal import rehearsed
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.maps.level import COARSE_MAP
from pacman_env.sim.observation.robot_view import RobotView
from pacman_env.sim.observation.situation import maps_of


def test_rehearsal_prepares_map_that_predicts_chase() -> None:
    """Its kernels take half a minute to compile, in which a game would stand still."""
    config = make_config("robot")
    view = RobotView(map_assets("house", config), config)
    (level,) = maps_of(view.rehearsal()).levels(np.array([0]))
    assert level.find(COARSE_MAP) is None
    rehearsed(make_policy("ppo"), view, config)
    assert level.find(COARSE_MAP) is not None
