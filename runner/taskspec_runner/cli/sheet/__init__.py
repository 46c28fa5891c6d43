"""The sheet of a task: all that `explain` shows of a file."""
