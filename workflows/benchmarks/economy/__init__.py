"""Cost of computing fewer variables."""
