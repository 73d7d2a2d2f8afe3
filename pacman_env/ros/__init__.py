"""The game as ROS 2 nodes, each started as ``python -m pacman_env.ros.NAME``; only this folder imports ROS.

Rules are in ``pacman_env.game``, policies in ``pacman_env.policies``. Importing the folder itself imports nothing."""
