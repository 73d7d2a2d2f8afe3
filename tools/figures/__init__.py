"""Measure the figures of the documentation and keep pages up to date with them: ``scripts/figures``."""
