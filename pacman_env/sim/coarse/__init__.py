"""A coarse model of the game, compiled: blocks of the map, a robot with lags, ghosts that react; for policies that plan."""
