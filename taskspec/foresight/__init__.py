"""What is known of a run before it: nominal course, ranges of signals, intervals."""
