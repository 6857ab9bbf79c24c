"""Elasticity by direction: Young's modulus, Poisson's ratio, compliance, and tensors of other conventions."""
