"""Rounds of a policy as a data set: recorded in batches, written as Minari's HDF5 and as Parquet, with a card beside."""
