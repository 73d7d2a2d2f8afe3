"""Run a policy once before the game, so that everything that it needs is loaded and compiled."""

import math
import time

import numpy as np

from pacman_env.config import Config
from pacman_env.game.behaviour_belief import CHASES
from pacman_env.observations.robot_view import RobotView
from pacman_env.policies.base import Policy
from pacman_env.policies.policy_calls import choose, name_of, reset, scores

SLOW_S = 1.0  # a slower choice is discarded, because robot and ghosts have moved


def rehearse(policy: Policy, view: RobotView, config: Config) -> Policy:
    """Run the policy and return it; raises ValueError or TypeError if it fails, or needs more than ``SLOW_S``.

    The policy chooses against a wandering ghost and a chasing ghost, because other code and data predict a chase.
    """
    situation, first = view.sample_situation(), np.ones(1, np.bool_)
    chased = situation.copy()
    chased.belief[...] = np.eye(chased.belief.shape[-1])[CHASES]
    reset(policy, first, config)
    fastest_s = math.inf
    for seen in (situation, chased, situation):  # the first calls may compile
        scores(policy, seen)
        start_s = time.perf_counter()
        choose(policy, seen)
        fastest_s = min(fastest_s, time.perf_counter() - start_s)
    if fastest_s > SLOW_S:
        raise ValueError(f"policy {name_of(policy)!r}: needs {fastest_s:.1f} s to choose, must be at most {SLOW_S:g} s")
    reset(policy, first, config)
    return policy
