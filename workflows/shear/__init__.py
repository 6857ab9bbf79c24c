"""Shear moduli: the unconstrained ascent, its compressed edges against size, and populations against size."""
