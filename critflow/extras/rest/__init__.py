"""Elasticity of springs at rest for any contrast of stiffness, and free components of the cell."""
