"""PacManBot as a learning environment: maps, game rules, simulator, policies.

Importing this package registers the environments with Gymnasium and loads nothing else; each part is imported by its
own name.
"""

from pacman_env._version import __version__
from pacman_env.envs.registration import register_envs

__all__ = ["__version__", "register_envs"]

register_envs()
