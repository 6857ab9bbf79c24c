"""The critical manifold: stress to configuration, quantities, stress Hessian."""
