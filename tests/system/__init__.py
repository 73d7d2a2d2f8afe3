"""Checks of the whole that take minutes: commands, each with a short run that is a test."""
