"""Logs that were recorded elsewhere: read, put onto a task's ticks, and judged."""
