"""Solvers for large networks: sparse ones by size (`choice`), and systems without multipliers from 100,000 edges."""
