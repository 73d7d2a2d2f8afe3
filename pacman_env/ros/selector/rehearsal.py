"""A policy's first decisions, which load and compile what the later ones need; they are not used."""

import numpy as np

from pacman_env.config import Config
from pacman_env.policies.asking import choose
from pacman_env.policies.base import Policy
from pacman_env.sim.observation.robot_view import RobotView


def rehearsed(policy: Policy, view: RobotView, config: Config) -> Policy:
    """The same policy, or ValueError, TypeError if it does not run."""
    situation, first = view.rehearsal(), np.ones(1, np.bool_)
    policy.reset(first, config)
    policy.scores(situation)
    choose(policy, situation)
    policy.reset(first, config)
    view.off_the_map(0.0, 0.0)
    return policy
