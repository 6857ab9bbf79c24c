"""Certificates of rigidity: counts and spaces of self-stresses and zero modes, with the gap behind them."""
