"""Rigidity: counts, first and second order, uniqueness, self-stress spaces, structure.  Constants in `tolerances`."""
