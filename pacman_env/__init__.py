"""PacManBot as a learning environment: maps, game rules, simulator, policies.

Importing this package registers the environments with Gymnasium, be that imported before or after, and loads nothing
else; each part is imported by its own name, and the multi-agent environments ``parallel_env``, ``env`` and
``parallel_vec_env`` when they are first asked for.
"""

from typing import Any

from pacman_env._version import __version__
from pacman_env.envs.registration import register_envs, register_when_imported

__all__ = ["__version__", "env", "parallel_env", "parallel_vec_env", "register_envs"]

register_when_imported()


def __getattr__(name: str) -> Any:
    if name in ("env", "parallel_env"):
        from pacman_env.envs import pettingzoo_env

        return getattr(pettingzoo_env, name)
    if name == "parallel_vec_env":
        from pacman_env.envs import parallel_vec_env

        return parallel_vec_env.PacManBotParallelVecEnv
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
