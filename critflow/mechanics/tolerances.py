"""Constants that decide in this layer, with their reasons.  Parameters of one algorithm stand in its module.

Floppy modes and compression, in units of the stiffness k

FLOPPY_SHIFT           Stiffness that regularises floppy modes.  They feel no force, so the shift changes no answer; the
                       stiffness of soft modes at a strain γ, about γ k, is far above it.
TAUT                   Where every stress σ is larger, the Hessian is at least that multiple of the Laplacian of the
                       network, and its pivots are not examined.
ROUNDING_COMPRESSION   A stress −σ below this number of its roundings may be rounding.
HESSIAN_ROUNDING       Eigenvalues of the Hessian below this part of the largest may have either sign: rounding of the
                       stresses, lengths and pivots.

Relaxation, forces in units of stiffness times length

LOOSEST_TOLERANCE      Newton's method never stops at a larger force: corrections by one factor then converge to the
                       exact equilibrium, and convergence is quadratic, so the last digits cost one step.
FINEST_TOLERANCE       Force that rounding leaves; no relaxation is repeated with a smaller tolerance.
ROUNDING_FORCE         Below this force a rejected step is due to rounding and not to a matrix that needs damping.
COLLAPSING_LENGTH      In a failed relaxation an edge below this part of the mean length is reported as collapsing.

Strain paths, distances in units of the mean length

EXPECTED_STEPS, EXPECTED_DISTANCE
                       A step may have left its branch if Newton's method took more steps, or ended further from the
                       prediction.  At 200 vertices and steps of 1e-3 it takes 2 to 5 steps; it ends within 2e-3
                       in the first step of strain and within 1e-6 in later ones.  With a third of 1,000 vertices
                       slack the first step takes 11 to 26 and ends within 2e-2; shorter ones take no fewer.
DOUBTED_DISTANCE, RETURN_DISTANCE
                       Ends further than the first from the prediction are accepted if the step back ends within the
                       second of the start: beyond a fold it ends on another branch, a distance of order one away.
BALANCED_START         Largest force of a state from which a path starts, in units of stiffness times length: the first
                       relaxation removes rounding, and a larger force would hide a jump.
LOOSENING_WORK         Work rate of the stress at the transition, relative to its size, above which the sign of a strain
                       decides between rigid and floppy; of smaller ones, second order and rounding may decide.
CONSISTENT_LENGTHS     Relative deviation of the lengths of taut edges from the given rest lengths; solutions have 1e-9.
OPENING                Displacement of floppy vertices that separates the ends of collapsed slack edges.

Moduli and coefficients

TRUSTED_ERROR          Largest error bound of a result, relative to the largest modulus or coefficient: its first digit
                       is correct.
CONSISTENT_RESPONSE    Largest relative residual of the linear system of the stiffening coefficients; a regular system
                       leaves 1e-14.
NO_WORK                A strain that does less work on the self-stress than this number times its rounding does none.

Springs at rest

GROUP_CONTRAST         Stiffnesses within this factor are compared directly; beyond it motions that stiffer edges resist
                       are separated from those that they do not.  Its square root enters rounding errors.
MODERATE_CONTRAST      Up to this contrast the self-stresses of a large network give its moduli with the rounding
                       errors of their compliance, which grow with it.
LARGEST_RESPONSE       Entries of the rigidity matrix up to which networks of larger contrast are decomposed densely.

Cells

COLLAPSED_EDGE         Edges below this part of the mean length are collapsed: ten times the accuracy of the cone
                       program, about 1e-6.
FITTED_PERIMETERS      Relative error of perimeters and forces after polishing; rounding leaves 1e-13.
CELL_STRESS_RANK       Singular values of the rigidity matrix of cells below this part of the largest count as zero.

Spring laws, in units of k ℓⁿ

LAW_AT_REST            Energy and tension that a law may have at rest: rounding of its formula.
LAW_STIFFNESS_AT_REST  Relative deviation of E'' from k at rest.
LAW_CONSISTENCY        Relative deviation of a function of a law from the fourth-order difference of the previous one,
                       with steps of a fiftieth of the reach of the law, which is accurate to 1e-7.
"""

from __future__ import annotations

FLOPPY_SHIFT = 1e-11
TAUT = 1e-7
ROUNDING_COMPRESSION, HESSIAN_ROUNDING = 16, 1e-14

LOOSEST_TOLERANCE = 1e-8
FINEST_TOLERANCE = 1e-14
ROUNDING_FORCE = 1e-13
COLLAPSING_LENGTH = 1e-3

EXPECTED_STEPS, EXPECTED_DISTANCE = 40, 0.05
DOUBTED_DISTANCE, RETURN_DISTANCE = 1e-3, 1e-6
BALANCED_START, LOOSENING_WORK = 1e-6, 1e-9
CONSISTENT_LENGTHS, OPENING = 1e-6, 1e-3

TRUSTED_ERROR = 0.1
CONSISTENT_RESPONSE = 1e-9
NO_WORK = 100.0

GROUP_CONTRAST = 1e3
MODERATE_CONTRAST = 1e6
LARGEST_RESPONSE = 6_000_000

COLLAPSED_EDGE = 1e-5
FITTED_PERIMETERS = 1e-11
CELL_STRESS_RANK = 1e-6

LAW_AT_REST = 1e-12
LAW_STIFFNESS_AT_REST = 1e-9
LAW_CONSISTENCY = 1e-4
