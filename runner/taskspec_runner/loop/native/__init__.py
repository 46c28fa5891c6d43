"""The closed loop in machine code: all ticks on which nothing happens that Python decides."""
