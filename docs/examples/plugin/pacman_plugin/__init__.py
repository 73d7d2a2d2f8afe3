"""An example of what can be added to pacman_env from a package of one's own."""
