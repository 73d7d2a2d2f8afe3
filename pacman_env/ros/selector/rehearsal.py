"""A policy's first decisions, which load and compile what the later ones need; they are not used."""

import numpy as np

from pacman_env.config import Config
from pacman_env.policies.asking import choose, reset, scores
from pacman_env.policies.base import Policy
from pacman_env.sim.observation.robot_view import RobotView


def rehearsed(policy: Policy, view: RobotView, config: Config) -> Policy:
    """The same policy, or ValueError, TypeError if it does not run."""
    situation, first = view.rehearsal(), np.ones(1, np.bool_)
    reset(policy, first, config)
    scores(policy, situation)
    choose(policy, situation)
    reset(policy, first, config)
    view.off_the_map(0.0, 0.0)
    return policy
