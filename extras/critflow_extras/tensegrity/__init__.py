"""Second-order rigidity, and stresses of both signs."""
