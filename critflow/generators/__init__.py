"""Generators of networks: lattices, random points, fibres, packings, dilution."""
