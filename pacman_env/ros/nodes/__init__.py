"""Nodes that only listen to the game: they turn events into lights, sounds and motions, or wait for a pose."""
