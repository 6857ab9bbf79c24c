"""Mechanics past the transition: spring laws, equilibria, strain paths, moduli, stiffening coefficients, cells.

Constants that decide are in `tolerances`; each error bound is marked as proof or estimate where it is defined.
"""
