"""Constants that several modules of this folder share, with their reasons."""

from __future__ import annotations

import numpy as np

# Relative spacing of doubles, 2⁻⁵².  A pivot below n EPS of the largest is as good as zero: rounding of the
# elimination makes pivots of that size.
EPS = float(np.finfo(float).eps)
# −δ on the diagonal of the multipliers of a saddle matrix, in units of 1/⟨|σ|⟩: it makes the matrix quasi-definite, so
# that any ordering factorises it, and refinement removes it.
REGULARISATION = 1e-7
STABLE_MARGIN = 1e-7  # part of the mean stress by which P must be positive on the zero modes to count as stable
# Most refinements of one saddle system; a step that does not reduce the residual by CONTRACTION ends it.
MOST_REFINEMENTS = 30
LARGEST_DENSE = 20_000_000  # largest number of entries of a dense array made in physics: 160 MB
