"""A run without a folder: what a program comes to in a world, and what is to be said of it."""
