"""Compiled stages: pure functions of the measurement, and the machine that strings them together."""
