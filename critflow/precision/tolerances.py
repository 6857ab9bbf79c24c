"""Constants of the extended precision that decide, with their reasons.

EXTENDED_ROUNDING  Error of a residual in double-double arithmetic, relative to the sizes of its terms: 4 roundings of
                   about 2⁻¹⁰⁶.
UNSEEN             Part of a rounding below which an error is invisible: refinement of a configuration stops there,
                   relative to the shortest edge, and corrections of an equilibrium, relative to the coordinates.
MOST_STEPS         Most steps of a refinement; each must halve the error, so that 40 span 12 digits.
LOST               Largest error of a refined configuration, relative to its coordinates.  Convergent refinement ends
                   far below, near the rounding of doubles.
DOUBTFUL           Relative error of a factor in the vector that it magnifies most, above which it is not trusted
                   (stresses of both signs).
HOPELESS           Condition times EPS above which a factor is not trusted (stresses of both signs): fewer than two
                   digits of a solve are then certain.
SAFETY             Safety factor of the error estimate for stresses of both signs: Hager's estimate of a condition is
                   a lower bound, usually sharp up to a factor of 3.
MOST_CORRECTIONS   Corrections of an equilibrium after which it counts as not convergent.
CONTRACTION        Each correction must shrink by this factor.
"""

from __future__ import annotations

from critflow.linalg.tolerances import EPS

EXTENDED_ROUNDING = 4 * EPS**2
UNSEEN = 0.05
MOST_STEPS = 40
LOST = 1e-12
DOUBTFUL = 0.1
HOPELESS = 0.02
SAFETY = 10.0
MOST_CORRECTIONS = 10
CONTRACTION = 0.5
