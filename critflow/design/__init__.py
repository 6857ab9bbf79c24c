"""Optimisation over critical configurations, targets, closed-form bounds, isogonal modes, tensegrity, topology."""
