"""Bounds on the share of completed rounds against predictable ghosts: ``pacman-env bound``."""
