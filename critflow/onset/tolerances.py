"""Constants that several modules of this folder share, with their reasons."""

from __future__ import annotations

NO_STRESS = 1e-9  # σ of an edge without tension, in units of ⟨|σ|⟩: rounding of a stress of order one
# Tolerances that distinguish slack edges from weakly stressed ones: nearly always, and always in tests.
EXACT_CONE = (1e-12, 1e-13)
# Tolerance from which Newton's method, which is far cheaper, converges if every edge is stressed. Positive tensions in
# balance at the right lengths prove that every edge is.
ROUGH_CONE = 1e-6
