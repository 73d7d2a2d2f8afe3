"""Protocol and registry of policies; the handcrafted ones are in ``heuristics``."""
