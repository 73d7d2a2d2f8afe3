"""Occupancy maps: read, write, check and generate them."""
