"""The ``pacman-env`` command."""
