"""Task files as tests: each is run and judged, and every expectation is a case of its own."""
