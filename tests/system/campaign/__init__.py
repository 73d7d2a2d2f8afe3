"""Random games of the robot's nodes, with faults: ``python -m tests.system.campaign``."""
