"""Fits of moduli past the transition."""
