"""The processes of a game: their list, start, supervision and end."""
