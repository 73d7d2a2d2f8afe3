"""Coarse model of the game for planning policies: blocks of the map, a robot with lags, ghosts that react to it."""
