"""Springs: laws, states and equilibria; tissues with springs on the perimeters of faces."""
