"""One stage of the file as pure functions: its law, its constraints, what ends it."""
