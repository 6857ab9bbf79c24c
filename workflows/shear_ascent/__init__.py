"""Unconstrained ascent of the shear modulus."""
