"""Generators of documentation and of ROS interfaces, run from the checkout."""
