"""Constants of the linear algebra that decide, with their reasons.

EPS              Relative spacing of doubles, 2⁻⁵².  A pivot below n EPS of the largest is as good as zero: rounding of
                 the elimination makes pivots of that size.
INERTIA_SHIFT    Shift δ in units of the mean value.  A matrix with the same inertia at ±δ counts as regular; the shift
                 is far above the rounding of pivots.
REFINED_SOLVES   Most refinements of a solve with A + δ.  Each reduces the error by δ over the smallest eigenvalue.
REGULARISATION   −δ on the diagonal of the multipliers of a saddle matrix, in units of 1/⟨|σ|⟩: it makes the matrix
                 quasi-definite, so that any ordering factorises it, and refinement removes it.
STABLE_MARGIN    Part of the mean stress by which P must be positive on the zero modes to count as stable.
CONDENSED_WEIGHT w |L|² of a condensed system in units of ⟨|σ|⟩.  The gap of R closes as 1/N_v: 1e8 takes 3 refinements
                 at 1,000 vertices and at 1,000,000.
REFINED          Relative residual at which a refinement is complete.
MOST_REFINEMENTS Most refinements of one saddle system; a step that does not reduce the residual by CONTRACTION ends it.
"""

from __future__ import annotations

import numpy as np

EPS = float(np.finfo(float).eps)
INERTIA_SHIFT = 1e-9
REFINED_SOLVES = 20
REGULARISATION = 1e-7
STABLE_MARGIN = 1e-7
CONDENSED_WEIGHT = 1e8
REFINED = 1e-15
MOST_REFINEMENTS = 30
CONTRACTION = 0.9
