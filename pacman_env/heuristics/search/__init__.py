"""Search on the coarse model of the game, for ghosts with a predictable behaviour."""
