"""Design of stiffnesses at rest, for prescribed moduli and elasticity tensors."""
