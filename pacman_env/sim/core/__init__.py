"""Games stepped together: their records, kernels and batches."""
