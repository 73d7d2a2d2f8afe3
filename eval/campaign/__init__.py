"""Randomised games of the robot's nodes, with faults: ``python -m eval.campaign``."""
