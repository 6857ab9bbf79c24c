"""Linear and nonlinear response: elasticity at the transition and under stress, stiffening."""
