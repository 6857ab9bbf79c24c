"""Generators of networks: lattices, and tessellations of random points."""
