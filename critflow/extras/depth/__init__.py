"""Drawings of periodic networks in space."""
