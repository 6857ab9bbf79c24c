"""Tolerances that decide in this layer: meaning, unit and reason of each.

Parameters of one algorithm alone (step factors, iteration limits) are constants of its module.
"""

# Floppy modes and compression, in units of the stiffness k

FLOPPY_SHIFT = 1e-11
"""Stiffness that regularises floppy modes.  They feel no force, so the shift changes no answer; the stiffness of soft
modes at a strain γ, about γ k, is far above it."""

NO_COMPRESSION = 1e-10
"""A stress −σ below this is rounding: σ is a difference of lengths, known to 1e-16 times the ratio of box to edge."""

SADDLE_SHIFT = 1e-8
"""A Hessian with negative eigenvalues after this shift belongs to a saddle; those of floppy modes are zero to 1e-10."""

# Relaxation

LOOSEST_TOLERANCE = 1e-8
"""Newton's method never stops at a larger relative force: corrections by one factor then converge to the exact
equilibrium, and convergence is quadratic, so the last digits cost one step."""

FINEST_TOLERANCE = 1e-14
"""Relative force that rounding leaves; no relaxation is repeated with a smaller tolerance."""

ROUNDING_FORCE = 1e-13
"""Relative force below which no accepted step means rounding, not a matrix that needs damping."""

COLLAPSING_LENGTH = 1e-3
"""In a failed relaxation an edge below this part of the mean length is reported as collapsing; the shortest edges of
relaxed cells are about 1e-2."""

# Strain paths

EXPECTED_STEPS, EXPECTED_DISTANCE = 10, 0.05
"""A step may have left its branch if Newton's method took more steps, or ended further (in mean lengths) from the
prediction.  Smooth branches need 2 to 5 steps and end within 1e-3."""

DOUBTED_DISTANCE, RETURN_DISTANCE = 1e-3, 1e-6
"""Ends further than the first from the prediction are accepted if the step back ends within the second of the start:
beyond a fold it ends on another branch, a distance of order one away."""

# Moduli and coefficients

TRUSTED_ERROR = 0.1
"""Largest error bound, relative to the largest modulus or coefficient, of a result: its first digit is correct."""

CONSISTENT_RESPONSE = 1e-9
"""Largest relative residual of the linear system behind the stiffening coefficients; a regular system leaves 1e-15."""

# Cells

COLLAPSED_EDGE = 1e-5
"""Edges below this part of the mean length are collapsed: ten times the accuracy of the cone program, about 1e-6."""

FITTED_PERIMETERS = 1e-11
"""Relative error of perimeters and forces after polishing; rounding leaves 1e-13."""

CELL_STRESS_RANK = 1e-6
"""Singular values of the rigidity matrix of cells below this part of the largest count as zero, as in `rigidity`."""

# Spring laws, relative to k ℓ^n

LAW_AT_REST, LAW_STIFFNESS_AT_REST = 1e-12, 1e-9
"""Energy and tension, and the deviation of E'' from k, that a law may have at rest: rounding of its formula."""

LAW_CONSISTENCY = 1e-4
"""Relative difference between a function of a law and the fourth-order difference of the previous one, whose steps are
a fiftieth of the reach of the law; differences are accurate to 1e-6."""
