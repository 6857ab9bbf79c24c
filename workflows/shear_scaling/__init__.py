"""Shear moduli against system size."""
