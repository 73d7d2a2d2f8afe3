"""The processes of a game: which there are, started, watched and stopped."""
