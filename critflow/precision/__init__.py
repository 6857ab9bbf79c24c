"""Double-double arithmetic, iterative refinement and error bounds."""
