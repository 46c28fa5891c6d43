"""TS4xx: what arm and motors can do."""
