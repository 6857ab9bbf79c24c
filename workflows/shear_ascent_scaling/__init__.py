"""The ascent against system size."""
