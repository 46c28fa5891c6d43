"""What the axes of a stage are to follow, and where the tool is on them."""
