"""Rotations and axes of space, as CasADi expressions and as arrays."""
