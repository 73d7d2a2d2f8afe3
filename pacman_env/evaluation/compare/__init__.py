"""Comparison of policies in the same rounds: ``pacman-env compare``."""
