"""Policies on the same rounds: ``python -m eval.compare``."""
