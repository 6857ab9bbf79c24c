"""Onsets of rigidity on any deformation, slack edges, and the surface of critical strains."""

from critflow_extras.cables import onset_start as onset_start
