"""Sparse solvers for networks of more than 100,000 vertices."""
