"""Simulate batches of games: world, rules and beliefs."""
