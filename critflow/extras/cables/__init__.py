"""Onsets of rigidity on any deformation, slack edges, and the surface of critical strains."""
