"""Six exercises: replace each ``raise NotImplementedError`` by your own code (docs/exercises/README.md).

Everything must stay in this file. Arrays are for N games with C candidates each: the pellets, then the refuges (safe
places), then *hold*. docs/policies.md lists all fields of a situation.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env import BasePolicy, Situation

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


def nearest_pellet(situation: Situation) -> tuple[Floats, Flags]:
    """Task 1. Return how far the nearest allowed pellet is, and whether Clyde is nearer to it than the robot.

    Input: ``kind`` (N, C) int8 (``pacman_env.PELLET``, ``REFUGE`` or ``HOLD``), ``mask`` (N, C) bool (allowed now),
    ``path_robot`` and ``path_clyde`` (N, C) float64, path lengths in m.

    Output: distances (N,) float64, the robot's path to its nearest allowed pellet in m, ``np.inf`` without an allowed
    pellet; and flags (N,) bool, True if Clyde's path to the same pellet is shorter, False without an allowed pellet.
    The situation must stay unchanged.
    """
    raise NotImplementedError


class Nearest(BasePolicy):
    """Task 2. Choose the allowed pellet with the shortest path."""

    name = "my_nearest"

    def scores(self, situation: Situation) -> Floats:
        """Return scores (N, C) float64, higher is better.

        The highest score of each game must belong to the allowed pellet with the shortest ``path_robot``, or to hold
        (the last candidate, always allowed) without an allowed pellet. A candidate that must not be chosen has
        ``-np.inf``.
        """
        raise NotImplementedError


class Avoid(BasePolicy):
    """Task 3. Choose no pellet that Clyde reaches first; wait if only such pellets remain."""

    name = "my_avoid"

    def scores(self, situation: Situation) -> Floats:
        """Return scores (N, C) float64, higher is better.

        A pellet is open if it is allowed and the robot is there first: ``path_robot`` (m) divided by the robot's speed
        is less than ``path_clyde`` (m) divided by ``clyde_speed`` (N,) m/s. The robot's speed is
        ``self.config.robot.speed_mps``. If a game has open pellets, the best candidate must be one of them.

        If a game has none, the best candidate must be the safest place to wait: of hold and the allowed refuges that
        the robot reaches first, the one that is farthest from Clyde. A refuge is ``path_clyde`` away, hold the straight
        distance in m between ``robot`` (N, 3: x, y, heading) and ``clyde`` (N, 2). Up to 1 m less than the farthest is
        accepted, so that you can prefer the candidate pursued now, ``current`` (N,), -1: none.
        """
        raise NotImplementedError


class LookAhead(BasePolicy):
    """Task 4. Judge the whole way to a pellet, not only its end."""

    name = "my_look_ahead"

    def scores(self, situation: Situation) -> Floats:
        """Return scores (N, C) float64, higher is better.

        A pellet lies behind Clyde if the way to it leads past Clyde: robot to Clyde (straight) + ``path_clyde`` is
        hardly longer than ``path_robot``. The best candidate must never be a pellet with a difference below 0.5 m
        while Clyde is within 2 m of the robot and another pellet or refuge has a difference above 3 m. You may also
        predict Clyde's next positions with ``clyde_velocity`` (N, 2) m/s.
        """
        raise NotImplementedError


def train() -> Any:
    """Task 5. Train a stock learner and return the model.

    The model plays ``pacman_env/PacManBotFlat-v2`` on the map ``house`` in batches of N games:
    ``model.predict(observation, action_masks=masks, deterministic=True)`` gets observations (N, 289) float32 and masks
    (N, 7) bool, and returns actions (N,) int and a second value that is ignored. ``sb3_contrib.MaskablePPO`` has this
    method. Every action must be allowed by its mask.

    This function may use 45 s of processor time. Return ``MaskablePPO.load(path)`` if you trained for longer before.
    """
    raise NotImplementedError


class Best(BasePolicy):
    """Task 6. Complete more rounds than the built-in scorer ``clyde_aware``, by any rule of your own."""

    name = "my_best"

    def scores(self, situation: Situation) -> Floats:
        """Return scores (N, C) float64, higher is better; built-in policies must not choose for you."""
        raise NotImplementedError
