"""Statements of the paper that a small network decides in a second."""
