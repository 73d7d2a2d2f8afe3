"""The protocol of policies, and how one is found by name; the handcrafted scorers live in ``heuristics``."""
