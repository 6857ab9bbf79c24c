"""Elasticity of springs at rest for any contrast of stiffness, and free components of the cell."""

from critflow_extras.rest import springs_at_rest as springs_at_rest
