"""Optimisation of quantities over all critical configurations."""
