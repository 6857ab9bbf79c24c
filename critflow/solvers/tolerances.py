"""Constants of the solvers that decide, with their reasons.

ARMIJO              Part of the predicted decrease that a step must reach (Nocedal & Wright, section 3.1).
ROUNDING            Relative change of a value that is rounding: the roundings of one sum over the edges.
FLAT                Curvature of a flat direction, relative to the steepest: the precision of Hessian-vector products.
IDLE                Steps of L-BFGS without a smaller value or residual after which rounding has stopped it.
NEGATIVE            Negative curvature that is not rounding, relative to the steepest: well above FLAT, as the few
                    Lanczos vectors do not resolve the end of the spectrum.
NEGATIVE_GRADIENTS  The same in units of the largest component of the gradient: where the gradient does not quite
                    vanish, flat directions have an apparent curvature of that size.
RESTORED            Violation of a constraint that counts as satisfied, in units of its size.
DEPENDENT           Eigenvalue of the Gram matrix of gradients below which they count as dependent, relative to the
                    largest: the rounding of gradients, squared, is below it.
FLOOR               Least eigenvalue of the Gram matrix with limits, relative to the largest: multipliers of dependent
                    limits stay finite, and the limits hold to this part.
CURVED              Cosine between a step and its change of gradient below which it says nothing about the curvature.
SEMIDEFINITE        Gap and feasibility of semidefinite programs: reached by Clarabel on all networks tested.
"""

ARMIJO = 1e-4
ROUNDING = 1e-14
FLAT = 1e-11
IDLE = 100
NEGATIVE = 1e-6
NEGATIVE_GRADIENTS = 10.0
RESTORED = 1e-11
DEPENDENT = 1e-14
FLOOR = 1e-12
CURVED = 1e-8
SEMIDEFINITE = 1e-10
