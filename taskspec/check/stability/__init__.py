"""TS5xx: stages that are predicted to ring or to grow, and what would mend them."""
