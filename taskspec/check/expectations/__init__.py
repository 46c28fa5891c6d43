"""TS7xx: expectations that cannot be met or judged."""
