"""What forces and rates can be had at a place, by the linear rows of arm, limits and contacts."""
