"""References in time: jerk-limited moves, paths, tables, and the blending between stages."""
