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
CURVED              Cosine between a step and its change of gradient below which it says nothing about the curvature.
SEMIDEFINITE        Gap and feasibility of semidefinite programs: reached by Clarabel on all networks tested.
TARGETS_MET         Largest miss of a target of order one that counts as met.
NEARLY_MET          Largest miss from which shortest steps meet the targets.
SEQUENTIAL_STEP     Change of r below which sequential programs have converged.
PRICE, PRICED       First and last price of a missed target of order one, in units of ½|r|².
RADIUS              First radius of the trust region, in units of r.
GAINS, GAINS_OF_MISS, IDLE_STEPS
                    Gain of a step relative to the cost, where targets are met and where they are missed, and number of
                    such steps in a row, that end a descent.
RESTORING           Steps that may meet the targets at the end: convergence is quadratic.
"""

ARMIJO = 1e-4
ROUNDING = 1e-14
FLAT = 1e-11
IDLE = 100
NEGATIVE = 1e-6
NEGATIVE_GRADIENTS = 10.0
RESTORED = 1e-11
DEPENDENT = 1e-14
CURVED = 1e-8
SEMIDEFINITE = 1e-10
TARGETS_MET = 1e-11
NEARLY_MET = 1e-3
SEQUENTIAL_STEP = 1e-9
PRICE, PRICED = 10.0, 1e4
RADIUS = 0.02
GAINS, GAINS_OF_MISS, IDLE_STEPS = 2e-3, 1e-5, 3
RESTORING = 12
