"""Episodes that policies play in the simulator, and the statistics of what comes of them."""
