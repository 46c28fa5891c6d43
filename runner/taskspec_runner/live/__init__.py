"""Pages that are looked at while they come about: a server on loopback, and what it serves."""
