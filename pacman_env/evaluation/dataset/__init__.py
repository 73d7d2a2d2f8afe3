"""Rounds of a policy as a data set: recorded many at once, written for Minari and as Parquet, with a card beside."""
