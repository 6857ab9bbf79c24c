"""Quantities of a configuration with their errors, and their exact gradients by stress and stiffness."""
