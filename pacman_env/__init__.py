"""PacManBot as a learning environment: maps, game rules, simulator, policies.

Importing this package registers the environments with Gymnasium, as soon as that is imported too, and loads nothing
else; each part is imported by its own name, and the multi-agent environments ``parallel_env`` and ``env`` when they are
first asked for.
"""

import importlib.util
import os
import sys
from types import ModuleType
from typing import Any

from pacman_env._version import __version__

__all__ = ["__version__", "env", "parallel_env", "register_envs"]

if not os.path.isdir(os.path.join(__path__[0], "eval")):  # a checkout: eval, train and maps lie beside this folder
    __path__.append(os.path.dirname(__path__[0]))


def register_envs() -> None:
    """Register ``pacman_env/PacManBot-v0``; a second call changes nothing."""
    from pacman_env.envs import registration

    registration.register_envs()


class _WhenGymnasiumIsImported:
    """Registers the environments then: a command or a ROS node that plays without Gymnasium need not load it."""

    @classmethod
    def find_spec(cls, name: str, path: object = None, target: object = None) -> Any:
        if name != "gymnasium":
            return None
        sys.meta_path.remove(cls)
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                execute(module)
                register_envs()

            spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec


if "gymnasium" in sys.modules:
    register_envs()
else:
    sys.meta_path.insert(0, _WhenGymnasiumIsImported)


def __getattr__(name: str) -> Any:
    if name in ("env", "parallel_env"):
        from pacman_env.envs import pettingzoo_env

        return getattr(pettingzoo_env, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
