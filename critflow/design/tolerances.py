"""Constants of the design layer that decide, with their reasons.

Stress and tension
NO_SIGNED_STRESS  Largest least |σ| of a linear program without solution: linear programs are solved to about 1e-9.
SIMPLEX_EDGES     Largest network whose linear program of signs the simplex method solves; interior points are seven
                  times faster at 3,000 edges.
MODERATE          Ratio of a stress to the median, at most, from which a failed descent is repeated: from 10 or 100 a
                  few starts of small networks return to limits that are no infima.
UNRESOLVED_STRESS Least σ, where Σσ² = N_b, at which a descent ends without an optimum: far below FADED.
FADED             σ that tends to zero, where Σσ² = N_b: far below the stresses of any optimum (1e-3).

Lengths
COLLAPSING        Length of an edge under tension that tends to zero, in units of the mean.
TENSE             Tension of an edge that does not fall slack, in units of the mean.
GAINING           Gain of an edge that collapses, relative to the largest gain: isogonal modes shorten others without.
SOUND             Shortest length, in units of the mean, and square root of the least stress of a configuration returned
                  for an optimum that is not attained: shorter edges lose digits in the rounding of the coordinates.
NO_LENGTH         Length, in units of the mean, of an edge that vanishes in the configuration of the largest modulus.
UNRESOLVED_LENGTH Length of the shortest edge, in units of the mean, at which a descent ends without an optimum: half of
                  the digits of its direction are lost.

Balance and optima
BALANCED          Relative force balance, and relative distance from the bound, of a modulus that attains its bound.
PARALLEL_FORCES   Determinant of the map F of forces, over |F|², below which all forces count as parallel: lengths grow
                  as its inverse.
ISOTROPIC         Anisotropy of a strain that is a dilation up to rounding.
CONVERGED_REST    Gain that remains at an infimum in the edges that do not tend to their limits, relative to the value;
                  standard networks reach 4e-4, and false infima have more than 1e-2.
STATIONARY        Gradient above which a descent was stopped early on purpose, by a rough tolerance: no saddle test.
NEARLY_SINGULAR   Smallest pivot over the largest of a nearly singular prestress matrix: lengths are then known to 1e-7.
TRAPPED           Number of successive steps at nearly singular matrices that show a limit at a singular one.
DIFFERENCE        Step of central differences of gradients: their error is its square, and rounding allows as many
                  digits.

Geometry
FLAT_TRIANGLE     Twice the area of a degenerate force triangle, over the square of the mean tension.
RANK              Singular value that counts as zero, relative to the largest.
SELF_STRESS_SHIFT Shift of the Hessian of unit springs, relative to ⟨|L|²⟩, which removes the zero modes of any
                  geometry.

Cuts
UNSUPPORTED       Part of a stress that flows around an edge below which its cut opens the network; rounding leaves
                  1e-13.
PRUNING_DRIFT     Error of rank-one updates from which P is factorised again: far below the digits of a design.
PRUNING_REACHED   Distance from a target that counts as reached, relative to it: cuts are discrete.

Targets
TARGET_STATIONARY The same of the least change of log k, relative to 1 plus the largest change.
TARGET_OPTIMAL    Component of the gradient of a preference along the surface of the targets, relative to 1 plus the
                  largest component of the gradient, below which it is least.
TARGET_NEAREST    The same of the least change, which is then mostly least to 1e-3: it only selects.
UNLIMITED         Gradient of a target by log σ, in units of its size, below which a search cannot start there.
ONSET_REACHED     Error of the strain of a designed onset.
BOUND_ROUNDING    Rounding of a closed-form bound, relative.
ONLY_STIFFEST     Relative distance from the largest B_0 within which its own relations count as attained.
INDEPENDENT_TARGETS
                  Least eigenvalue of the cosines of the gradients of targets that can be changed independently.
POSITIVE_TENSOR   Eigenvalues of a requested tensor below this part of the largest one count as zero.
SAME_LAW          Relative difference of tensions below which a spring law counts as homogeneous.

Isogonal design
SHORTEST_ISOGONAL Shortest length of an isogonal design by default, in units of the mean: as SOUND.
ISOGONAL_NEAREST  As TARGET_NEAREST for isogonal amplitudes.
STIFFEST          Relative distance from the largest B_0 at which C_B is the closed form for all isogonal changes.

Fronts
FRONT_OPTIMAL     Gradient at which the search for a point ends, in units of the ends of the front.
FRONT_CERTIFIED   Largest relative residual of the first-order conditions of a certified point.
FRONT_FLAT        Gradients below this, in units of the ends, count as zero.
BETTER_END        Improvement of an end, in units of the ends, with which a front is computed again.
SAME_END          Relative difference of values below which both objectives have the same best configuration.
END_WEIGHT        Weight of the other objective at an end: without it ends with many best configurations are arbitrary.

Nearest configuration
NEAREST_CONVERGED Change of log σ in a step of Gauss and Newton below which it has converged.
NEAREST_DAMPING   First damping of these steps, in units of the mean square of the coordinates.
NEAREST_REGULARISATION
                  Regularises the multipliers of balance, relative to the mean stress: pivots of both signs stay apart.
NEAREST_RIDGE     First regularisation of log σ, relative to the mean square length: an infimum that is not attained
                  then has a minimiser.
NEAREST_STALLED   Relative gradient that shows a stalled descent to have reached its infimum.
WIDEST_STRESS     |log σ| relative to the mean beyond which an edge counts as collapsed or slack.
SMALLEST_START    Smallest stress that a descent starts from, relative to the mean: stresses in balance at noisy
                  positions may be negative.
"""

UNSUPPORTED = 1e-10
PRUNING_DRIFT = 1e-10
PRUNING_REACHED = 1e-3

TARGET_STATIONARY = 1e-5
TARGET_OPTIMAL = 1e-3
TARGET_NEAREST = 2e-2
UNLIMITED = 1e-6
ONSET_REACHED = 1e-10
BOUND_ROUNDING = 1e-12
ONLY_STIFFEST = 1e-9
INDEPENDENT_TARGETS = 1e-6
POSITIVE_TENSOR = 1e-12
SAME_LAW = 1e-12

FRONT_OPTIMAL = 2e-9
FRONT_CERTIFIED = 1e-5
FRONT_FLAT = 1e-4
BETTER_END = 1e-3
SAME_END = 1e-4
END_WEIGHT = 1e-2

SHORTEST_ISOGONAL = 5e-2
ISOGONAL_NEAREST = 1e-2
STIFFEST = 1e-9

NEAREST_CONVERGED = 1e-9
NEAREST_DAMPING = 1e-9
NEAREST_REGULARISATION = 1e-12
SMALLEST_START = 0.05
NEAREST_RIDGE = 1e-8
NEAREST_STALLED = 1e-7
WIDEST_STRESS = 9.2

NO_SIGNED_STRESS = 1e-7
SIMPLEX_EDGES = 1000
FADED = 1e-12
MODERATE = 3.0
UNRESOLVED_STRESS = 1e-20
COLLAPSING = 1e-4
TENSE = 0.01
GAINING = 0.1
SOUND = 1e-2
NO_LENGTH = 1e-10
UNRESOLVED_LENGTH = 1e-8
BALANCED = 1e-8
PARALLEL_FORCES = 1e-9
ISOTROPIC = 1e-14
CONVERGED_REST = 1e-3
STATIONARY = 1e-8
NEARLY_SINGULAR = 1e-9
TRAPPED = 20
DIFFERENCE = 1e-5
FLAT_TRIANGLE = 1e-12
RANK = 1e-9
SELF_STRESS_SHIFT = 1e-12
