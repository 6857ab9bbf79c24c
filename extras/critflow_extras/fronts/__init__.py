"""Fronts of several quantities, pruning towards a target, and the leverage of edges."""
