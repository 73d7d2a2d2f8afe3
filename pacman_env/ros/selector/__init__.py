"""The goal selector: a policy on the robot."""
