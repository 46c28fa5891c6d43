"""Stability of stages: their sampled loops, the margins of these, and gains held against them."""
