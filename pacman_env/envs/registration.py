"""Registers the environments with Gymnasium: at once where that is imported already, else as soon as it is.

So a process that never asks for an environment, such as a robot's node, does without Gymnasium's 8 MB.
"""

from __future__ import annotations

import importlib.util
import sys
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

ENV_ID = "pacman_env/PacManBot-v0"
#: The same game as a learner likes it best; its arguments are those of v0 with these for defaults.
LEARNERS_ID = "pacman_env/PacManBot-v1"
LEARNERS_DEFAULTS = {
    "decide": "event",
    "candidates": "nearest",
    "observation": ("planner", "flat"),
    "normalize": True,
    "mask": "method",
    "numeric_info": True,
    "timeout": "termination",
}


def register_envs() -> None:
    """Register ``pacman_env/PacManBot-v0`` and ``-v1``; a second call changes nothing."""
    import gymnasium as gym

    for name, defaults in ((ENV_ID, {}), (LEARNERS_ID, LEARNERS_DEFAULTS)):
        if name not in gym.registry:
            gym.register(
                name,
                entry_point="pacman_env.envs.pacmanbot:PacManBotEnv",
                vector_entry_point="pacman_env.envs.pacmanbot_vector:PacManBotVectorEnv",
                kwargs=dict(defaults),
            )


def register_when_imported() -> None:
    """Register now if Gymnasium is imported, else at the end of its import."""
    if "gymnasium" in sys.modules:
        register_envs()
    else:
        sys.meta_path.insert(0, _GymnasiumFinder())


class _GymnasiumFinder:
    """Finds Gymnasium once, as any other finder would, and has the environments registered when it is loaded."""

    def find_spec(self, fullname: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        if fullname != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def load_and_register(module: ModuleType) -> None:
                load(module)
                register_envs()

            spec.loader.exec_module = load_and_register  # type: ignore[method-assign]
        return spec
