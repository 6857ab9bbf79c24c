"""Springs: laws, states and equilibria; cells with springs on their perimeters."""
