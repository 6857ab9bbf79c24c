"""Strain paths: equilibria followed in strain, with exact derivatives of their responses."""
