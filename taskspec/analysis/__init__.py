"""Compiled stages as sampled linear systems: poles, margins and the textbook's own conditions."""
