"""Gains that are stable and meet what a file expects in every world that `vary` allows."""
