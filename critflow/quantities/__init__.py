"""Quantities of critical configurations by name: values, gradients, errors, largest values."""
