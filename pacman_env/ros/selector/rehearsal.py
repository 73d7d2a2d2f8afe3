"""Run a policy once before the game, so that everything that it needs is loaded and compiled."""

import numpy as np

from pacman_env.config import Config
from pacman_env.game.behaviour_belief import CHASES
from pacman_env.policies.asking import choose, reset, scores
from pacman_env.policies.base import Policy
from pacman_env.sim.observation.robot_view import RobotView


def rehearsed(policy: Policy, view: RobotView, config: Config) -> Policy:
    """Run the policy once and return it; raises ValueError or TypeError if it fails.

    It sees a wandering and a chasing ghost, because a map of its own predicts the chase.
    """
    situation, first = view.rehearsal(), np.ones(1, np.bool_)
    chased = situation.copy()
    chased.belief[...] = np.eye(chased.belief.shape[-1])[CHASES]
    reset(policy, first, config)
    for seen in (situation, chased):
        scores(policy, seen)
        choose(policy, seen)
    reset(policy, first, config)
    view.off_the_map(0.0, 0.0)
    return policy
