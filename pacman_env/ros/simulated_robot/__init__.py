"""A simulated robot behind the interface of the real one."""
