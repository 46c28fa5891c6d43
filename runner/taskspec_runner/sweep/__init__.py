"""Many worlds of a task: run, judged, and what they say together."""
