"""TS2xx: axes, laws, frames and signals that do not go together."""
