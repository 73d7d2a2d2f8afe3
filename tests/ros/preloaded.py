"""What nodes have imported and compiled before they start; only the fork server's server imports this."""

from pacman_env.ros import topics
from pacman_env.ros.nodes import wait_for_amcl_pose  # noqa: F401
from pacman_env.ros.pacman_game import pacman_game  # noqa: F401
from pacman_env.ros.selector import goal_selector_node  # noqa: F401
from pacman_env.ros.selector.policy_child import Policies, PolicySetup
from pacman_env.ros.simulated_robot import sim_robot  # noqa: F401
from pacman_env.ros.supervisor import watcher  # noqa: F401

for _one in vars(topics).values():
    if isinstance(_one, topics.Topic | topics.Service | topics.RosAction) and _one is not topics.DIAGNOSTIC_ARRAY:
        _one.type.__import_type_support__()
for _policy in ("clyde_aware", "lookahead"):
    Policies(PolicySetup(_policy, "house", "robot", "robust", []))
