"""Spring laws, equilibrium, strain paths, moduli, stiffening coefficients, perimeters."""
