"""A simulated robot with the interface of the real robot."""
