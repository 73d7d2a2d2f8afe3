"""Batches of games that are stepped together: records, kernels and classes."""
