"""Measurements of the project itself, for a checkout; docs/performance.md shows their figures."""
