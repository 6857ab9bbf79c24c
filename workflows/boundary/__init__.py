"""Boundary vectors and shear."""
