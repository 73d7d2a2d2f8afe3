"""Measuring policies against each other in the simulator: rounds, statistics, tables, pictures.

Run from the checkout: ``python -m eval.compare``. Games are simulated in ``pacman_env.sim``; nothing
here trains.
"""
