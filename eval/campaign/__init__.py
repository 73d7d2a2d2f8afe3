"""Random games of the robot's nodes, with faults: ``pacman-env campaign``."""
