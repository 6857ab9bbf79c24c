"""Fibre networks, packings, regular networks and dilution."""
