"""Handcrafted policies: the scorer of Algorithm 3, look-ahead, search, nearest pellet, random choices."""
