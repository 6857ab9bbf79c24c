"""Time and memory against system size."""
