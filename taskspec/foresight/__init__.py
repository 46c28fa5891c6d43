"""What is known of a run before it: ranges of signals, approaches, forces at rest."""
