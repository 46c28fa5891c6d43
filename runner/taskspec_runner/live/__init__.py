"""Pages watched while a run or a sweep goes on: a server on loopback, and what it serves."""
