"""Sparse linear algebra: matrices with a fixed pattern, their factors, and the solver back ends."""
