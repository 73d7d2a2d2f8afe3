"""PacManBot as a learning environment: maps, game rules, simulator, policies and the robot's nodes.

Importing this package loads nothing but the version; each part is imported by its own name.
"""

from pacman_env._version import __version__

__all__ = ["__version__"]
