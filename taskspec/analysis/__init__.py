"""A task run ahead on a plain plant, and what its signals tell of how it ends."""
