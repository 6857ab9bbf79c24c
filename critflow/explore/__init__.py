"""A page on which critical configurations are changed by hand: its state, its numbers and its server."""
