"""Policies measured against each other in the simulator: episodes, statistics, tables, pictures; and the benchmarks.

In the checkout ``eval``, in the package ``pacman_env.eval``: modules import one another
relatively. Nothing here trains.
"""
