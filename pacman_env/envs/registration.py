"""Registers the environments with Gymnasium when the package is imported."""

from __future__ import annotations

import gymnasium as gym

ENV_ID = "pacman_env/PacManBot-v0"


def register_envs() -> None:
    """Register ``pacman_env/PacManBot-v0``; a second call changes nothing."""
    if ENV_ID not in gym.registry:
        gym.register(
            ENV_ID,
            entry_point="pacman_env.envs.pacmanbot:PacManBotEnv",
            vector_entry_point="pacman_env.envs.pacmanbot_vector:PacManBotVectorEnv",
        )
