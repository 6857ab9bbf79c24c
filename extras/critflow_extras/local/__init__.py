"""The response of one pair of vertices to another at the transition: allostery by geometry alone."""
