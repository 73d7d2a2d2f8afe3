"""Play episodes with policies in the simulator, and compute statistics of the results."""
