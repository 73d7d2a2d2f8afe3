"""What is possible on a map against ghosts whose reaction is known: ``pacman-env bound``."""
