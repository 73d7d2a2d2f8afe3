"""HTML page about a comparison: ``pacman-env report``."""
