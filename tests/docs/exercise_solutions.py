"""Solutions of docs/exercises/tasks.py, for teachers and for the tests of the grader."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env import HOLD, PELLET, BasePolicy, Situation, make_policy

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


def nearest_pellet(situation: Situation) -> tuple[Floats, Flags]:
    """Task 1. Read the paths of the nearest pellet."""
    allowed = situation.mask & (situation.kind == PELLET)
    path_m = np.where(allowed, situation.path_robot, np.inf)
    games, nearest = np.arange(len(situation)), path_m.argmin(axis=1)
    distance_m = path_m[games, nearest]
    return distance_m, np.isfinite(distance_m) & (situation.path_clyde[games, nearest] < distance_m)


def pursued(situation: Situation) -> Flags:
    """Return the candidate (N, C) that each game pursues."""
    return np.arange(situation.kind.shape[1]) == situation.current[:, None]


def gap(situation: Situation) -> Floats:
    """Return the straight distance (N, 1) between robot and Clyde, m."""
    return np.linalg.norm(situation.clyde - situation.robot[:, :2], axis=1)[:, None]


def clyde_away(situation: Situation) -> Floats:
    """Return the distance (N, C) between Clyde and each candidate, m."""
    return np.where(situation.kind == HOLD, gap(situation), situation.path_clyde)


class Nearest(BasePolicy):
    """Task 2."""

    name = "my_nearest"

    def scores(self, situation: Situation) -> Floats:
        """Return minus the path length, in m."""
        pellet = situation.mask & (situation.kind == PELLET)
        hold = np.where(situation.kind == HOLD, -1000.0, -np.inf)
        return np.where(pellet, -situation.path_robot, hold)


class Avoid(BasePolicy):
    """Task 3."""

    name = "my_avoid"

    def scores(self, situation: Situation) -> Floats:
        """Return minus the path length of open pellets, and for places to wait the distance from Clyde minus 1 km."""
        s = situation
        first = s.path_robot / self.config.robot.speed_mps < s.path_clyde / s.clyde_speed[:, None]
        place = np.where(first, clyde_away(s) - 1000.0, -np.inf)
        keep = 0.9 * pursued(s)
        return np.where(s.kind == PELLET, np.where(first, -s.path_robot, -np.inf), place) + keep


class LookAhead(BasePolicy):
    """Task 4."""

    name = "my_look_ahead"
    #: The robot meets Clyde if both are this near within this time, going straight on.
    meeting_m, meeting_s = 0.8, 5

    def scores(self, situation: Situation) -> Floats:
        """Return minus the cost in m: the way, 60 m for a way past Clyde, 30 m for a meeting, 18 to 30 m to wait."""
        s = situation
        away = clyde_away(s)
        behind = (gap(s) + away - s.path_robot < 1.5) & (gap(s) < 5.0)
        cost_m = s.path_robot + 60.0 * behind + 30.0 * self.meets(s) + 3.0 * (away < s.path_robot) - pursued(s)
        return -np.where(s.kind == PELLET, cost_m, cost_m + 30.0 - 3.0 * np.minimum(away, 4.0))

    def meets(self, s: Situation) -> Flags:
        """Return on which ways (N, C) the robot meets Clyde."""
        ahead = s.position - s.robot[:, None, :2]  # (N, C, 2)
        straight = np.maximum(np.linalg.norm(ahead, axis=2, keepdims=True), 1e-6)
        meets = np.zeros(s.mask.shape, dtype=bool)
        for t in range(1, self.meeting_s + 1):
            driven = ahead / straight * np.minimum(self.config.robot.speed_mps * t, straight)
            clyde = s.clyde + s.clyde_velocity * t - s.robot[:, :2]  # (N, 2), from the robot
            meets |= np.linalg.norm(driven - clyde[:, None], axis=2) < self.meeting_m
        return meets


class Best(LookAhead):
    """Task 6. Look ahead for longer, with a larger distance."""

    name = "my_best"
    meeting_m, meeting_s = 1.0, 7


def train(rounds: int = 64, decisions: int = 200, epochs: int = 6) -> Any:
    """Task 5. Let the network of a MaskablePPO imitate ``lookahead``."""
    import torch
    from sb3_contrib import MaskablePPO

    from pacman_env.sb3 import PacManBotVecEnv

    torch.set_num_threads(1)
    games = PacManBotVecEnv(rounds, flat=True, map="house")
    model, teacher = MaskablePPO("MlpPolicy", games, seed=0, device="cpu"), make_policy("lookahead")
    observation: Any = games.reset()
    steps = []
    teacher.reset(np.ones(rounds, dtype=bool), games.env.config)
    for _ in range(decisions):
        action = games.env.action_of(teacher.select(games.env.situation))
        steps.append((observation, action, games.env.action_masks()))
        observation, *_ = games.step(action)
    seen, chosen, masks = (torch.as_tensor(np.concatenate(part)) for part in zip(*steps, strict=True))
    optimizer = torch.optim.Adam(model.policy.parameters(), lr=1e-3)
    for _ in range(epochs):
        for batch in torch.randperm(len(seen)).split(256):
            _, log_probability, _ = model.policy.evaluate_actions(seen[batch], chosen[batch], masks[batch])
            optimizer.zero_grad()
            (-log_probability.mean()).backward()
            optimizer.step()
    return model
