"""The nodes of the game except the goal selector, one module each."""
