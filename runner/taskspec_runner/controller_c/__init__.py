"""The controller of a task as C99, for whoever links it: `taskspec export FILE --c DIR`."""
