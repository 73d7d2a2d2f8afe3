"""Search on the coarse model of the game, for ghosts whose behaviour is known."""
