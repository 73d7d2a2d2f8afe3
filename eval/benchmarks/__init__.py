"""Measurements of speed, time and memory; each module is a command."""
