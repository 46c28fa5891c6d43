"""What lies under a folder of runs: what each came to, and since when a task misses."""
