"""Occupancy maps: read, written, checked, and drawn by code."""
