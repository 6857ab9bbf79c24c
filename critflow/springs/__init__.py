"""Springs: laws, states and equilibria."""
