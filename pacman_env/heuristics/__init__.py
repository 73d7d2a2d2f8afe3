"""Handcrafted goal selectors: the Clyde-aware scorer of Algorithm 3, look-ahead, nearest pellet, random pellet."""
