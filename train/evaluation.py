"""Rounds of a network in training against rules, on levels that it is not trained on."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from pacman_env.policies.base import BasePolicy
from pacman_env.sim.features import planner_features
from pacman_env.sim.situation import Situation
from train.network import EntityNetwork


class NetworkPolicy(BasePolicy):
    """A network in training as a policy."""

    name = "ppo"

    def __init__(self, network: EntityNetwork, robot_speed_mps: float = 0.256) -> None:
        self._network = network
        self._speed = robot_speed_mps

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """(N, C) logits, -inf for what may not be chosen."""
        candidates, whole = planner_features(situation, self._speed)
        arrays = (candidates, whole, situation.mask)
        with torch.no_grad():
            logits, _ = self._network.packed(*(torch.from_numpy(array) for array in arrays))
        return np.where(situation.mask, logits.numpy().astype(np.float64), -np.inf)
