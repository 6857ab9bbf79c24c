"""The critical manifold: stress to configuration, objectives, curvature, stress Hessian."""
