"""TS3xx: contacts, constraints, and forces that they cannot return."""
