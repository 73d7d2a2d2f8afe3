"""One round again, filmed: ``pacman-env replay``."""
