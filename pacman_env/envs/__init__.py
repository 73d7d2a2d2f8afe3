"""Gymnasium environments over the simulator, their pictures and their registration."""
