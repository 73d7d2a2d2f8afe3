"""Run a policy once before the game, so that everything that it needs is loaded and compiled."""

import numpy as np

from pacman_env.config import Config
from pacman_env.policies.asking import choose, reset, scores
from pacman_env.policies.base import Policy
from pacman_env.sim.observation.robot_view import RobotView


def rehearsed(policy: Policy, view: RobotView, config: Config) -> Policy:
    """Run the policy once and return it; raises ValueError or TypeError if it fails."""
    situation, first = view.rehearsal(), np.ones(1, np.bool_)
    reset(policy, first, config)
    scores(policy, situation)
    choose(policy, situation)
    reset(policy, first, config)
    view.off_the_map(0.0, 0.0)
    return policy
