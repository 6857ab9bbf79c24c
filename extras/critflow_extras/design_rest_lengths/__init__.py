"""Design of rest lengths of cables, for prescribed onsets of rigidity."""
