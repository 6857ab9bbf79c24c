"""Constants of the solvers that decide, with their reasons.

ARMIJO              Part of the predicted decrease that a step must reach (Nocedal & Wright, section 3.1).
ROUNDING            Relative change of a value that is rounding: the roundings of one sum over the edges.
FLAT                Curvature of a flat direction, relative to the steepest: the precision of Hessian-vector products.
IDLE                Steps of L-BFGS without a smaller value or residual after which rounding has stopped it.
NEGATIVE            Negative curvature that is not rounding, relative to the steepest: well above FLAT, as the few
                    Lanczos vectors do not resolve the end of the spectrum.
NEGATIVE_GRADIENTS  The same in units of the largest component of the gradient: where the gradient does not quite
                    vanish, flat directions have an apparent curvature of that size.
SEMIDEFINITE        Gap and feasibility of semidefinite programs: reached by Clarabel on all networks tested.
"""

ARMIJO = 1e-4
ROUNDING = 1e-14
FLAT = 1e-11
IDLE = 100
NEGATIVE = 1e-6
NEGATIVE_GRADIENTS = 10.0
SEMIDEFINITE = 1e-10
