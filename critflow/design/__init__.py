"""Optimisation over critical configurations, closed-form bounds, rest lengths, isogonal modes, tensegrity."""
