"""What nodes have imported and compiled before they start; only the fork server's server imports this."""

import logging

from pacman_env.config import make_config
from pacman_env.ros import topics
from pacman_env.ros.node import Once
from pacman_env.ros.nodes import (  # noqa: F401
    audio_node,
    clyde_ghost_node,
    game_controller,
    game_event_mapper,
    game_light_node,
    pellet_manager,
    wait_for_amcl_pose,
)
from pacman_env.ros.selector import goal_selector  # noqa: F401
from pacman_env.ros.selector.pose_watch import PoseLimits
from pacman_env.ros.selector.selection import Selection
from pacman_env.ros.simulated_robot import sim_robot  # noqa: F401

for _one in vars(topics).values():
    if isinstance(_one, topics.Topic | topics.Service | topics.RosAction):
        _one.type.__import_type_support__()
for _policy in ("clyde_aware", "lookahead"):
    Selection(make_config(), "house", _policy, None, PoseLimits(), Once(logging.getLogger(__name__), lambda: 0.0))
