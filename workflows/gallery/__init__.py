"""Configurations at the optima."""
