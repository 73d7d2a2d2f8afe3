"""Gymnasium and PettingZoo environments over the simulator, and their registration."""
