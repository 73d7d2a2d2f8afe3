"""Handcrafted goal selectors: the scorer of Algorithm 3, look-ahead, search, nearest pellet, random pellet."""
