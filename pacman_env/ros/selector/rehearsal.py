"""A policy's first decisions, which count for nothing: they load and compile what the later ones need."""

from __future__ import annotations

import numpy as np

from pacman_env.config import Config
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy
from pacman_env.sim.observation.robot_view import RobotView

_ONE = np.ones(1, np.bool_)


def rehearsed(spec: str, view: RobotView, config: Config) -> Policy:
    """A policy that has decided on the map of a robot's view before.

    Args:
        spec: a name of the registry, or an .onnx file.
        view: of one robot.
        config: what is played by.

    Raises:
        ValueError: it cannot be loaded or does not run; ModuleNotFoundError and TypeError likewise.
    """
    policy, situation = make_policy(spec), view.rehearsal()
    policy.reset(_ONE, config)
    policy.scores(situation)
    policy.select(situation)
    policy.reset(_ONE, config)
    view.off_the_map(0.0, 0.0)
    return policy
