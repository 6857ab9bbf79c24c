"""Counts of freedom and self-stress, and certificates of rigidity."""
