"""The game as ROS 2 nodes, each started as ``python -m pacman_env.ros.NAME``.

The nodes are thin: rules live in ``pacman_env.game``, choices in ``pacman_env.policies``; here they meet messages.
Only this folder imports ROS, and importing the folder itself imports nothing.
"""
