"""Rest lengths to critical configurations."""
