"""A coarse model of the game, for policies that plan: blocks of the map, a robot with lags, ghosts that react."""
