"""Writes results/README.md and the tables of the documents."""
