"""Handcrafted goal selectors: the Clyde-aware scorer of Algorithm 3, nearest pellet, random pellet.

They are policies like any other; how policies are found by name and how learned ones run is ``policies``.
"""
