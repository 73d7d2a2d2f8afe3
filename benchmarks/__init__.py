"""Measurements of the project itself, to be run in a checkout; docs/performance.md has their figures."""
