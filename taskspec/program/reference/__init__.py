"""References of the axes of a stage, and the coordinates of the tool on them."""
