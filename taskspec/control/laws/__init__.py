"""One short function per control law, readable beside the chapter's numbered equations."""
