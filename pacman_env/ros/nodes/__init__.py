"""The nodes of the game, beside the goal selector; one module each."""
