"""Linear and nonlinear response: elasticity at rest, under stress and at the transition; stiffening."""
