"""Run tasks without state in this process, in several processes, or on a Ray cluster."""
