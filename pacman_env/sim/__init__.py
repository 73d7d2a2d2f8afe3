"""Simulate batches of games (world, rules and beliefs) and build the situations that policies observe."""
