"""Local responses on the critical manifold."""
