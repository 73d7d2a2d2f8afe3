"""Policies on the same rounds: ``pacman-env compare``."""
