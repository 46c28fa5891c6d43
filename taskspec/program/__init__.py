"""Compiled stages: pure functions, and the machine that strings them together."""
