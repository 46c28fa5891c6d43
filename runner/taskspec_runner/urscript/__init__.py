"""A task as a program of a Universal Robots arm."""
