"""Definitions of ROS 2 Jazzy message types that robots have but ROS's wheels for pip lack, and their build.

Robots and installations of ROS by system packages already have these types and do not need this package.
"""
