"""Plant and controller that are not one loop: robots behind a protocol, a plant as a server."""
