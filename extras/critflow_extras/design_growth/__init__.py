"""Growth of the moduli past the transition as quantities: C_B, C_G and the stiffening along a path can be designed."""
