"""Data sets of rounds: recorded many at once, written for Minari and as Parquet, with a card."""
