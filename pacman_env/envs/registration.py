"""Registers the environments with Gymnasium and PettingZoo: at once where they are imported already, else then.

So a process that never asks for an environment, such as a robot's node, does without Gymnasium's 8 MB.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
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
#: Of several agents, who all decide at each tick.
SEVERAL_LEARNERS_DEFAULTS = {
    "observation": "flat",
    "normalize": True,
    "mask": "beside",
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


def register_parallel_envs() -> None:
    """Register the same names for several agents; does nothing before PettingZoo 1.27, which has no registry."""
    import pettingzoo

    if not hasattr(pettingzoo, "register"):
        return
    for kind, known in (("parallel", pettingzoo.parallel_registry), ("aec", pettingzoo.aec_registry)):
        entry_point = f"pacman_env:{'parallel_env' if kind == 'parallel' else 'env'}"
        for name, defaults in ((ENV_ID, {}), (LEARNERS_ID, SEVERAL_LEARNERS_DEFAULTS)):
            if name not in known:
                pettingzoo.register(kind, name, entry_point, kwargs=dict(defaults))


def register_when_imported() -> None:
    """Register now with what is imported, else at the end of its import."""
    for name, register in (("gymnasium", register_envs), ("pettingzoo", register_parallel_envs)):
        if name in sys.modules:
            register()
        else:
            sys.meta_path.insert(0, _Finder(name, register))


class _Finder:
    """Finds a module once, as any other finder would, and does something when it is loaded."""

    def __init__(self, module: str, then: Callable[[], None]) -> None:
        self._module, self._then = module, then

    def find_spec(self, fullname: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        if fullname != self._module:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def load_and_register(module: ModuleType) -> None:
                load(module)
                self._then()

            spec.loader.exec_module = load_and_register  # type: ignore[method-assign]
        return spec
