"""One round again, filmed: ``python -m eval.replay``."""
