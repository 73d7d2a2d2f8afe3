"""Pictures of a game, and the window that shows them."""
