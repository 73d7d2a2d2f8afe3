"""Data sets of rounds: recorded in batches, written for Minari and as Parquet, with a card."""
