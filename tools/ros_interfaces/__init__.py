"""Definitions of message types that robots have and ROS's wheels for pip have not, as in ROS 2 Jazzy; and their build.

On a robot, and wherever ROS comes from the system's packages, these types are there already and nothing here is used.
"""
