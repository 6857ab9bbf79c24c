"""Constants of the design layer that decide, with their reasons.

Stress and tension
NO_STRESS         σ of an edge without tension, in units of ⟨|σ|⟩: rounding of a stress of order one.
WEAK_STRESS       σ below which the weakest edges are released first when Newton's method fails, in units of ⟨σ⟩; it
                  grows tenfold from one attempt to the next.
NO_SIGNED_STRESS  Largest least |σ| of a linear program without solution: linear programs are solved to about 1e-9.
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
SOLVED            Relative residual of a Newton step that determines the error of its start.
FITTED            Relative error of the lengths of a solution of Newton's method; short edges limit it by rounding.
EVEN              Spread of the logarithms of rest lengths below which few networks have slack edges.

Balance and optima
BALANCED          Relative force balance, and relative distance from the bound, of a modulus that attains its bound.
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
BALANCE_SHIFT     The same near the transition, where lengths are of order one.

Cone program
EXACT_CONE        Tolerances that distinguish slack edges from weakly stressed ones: nearly always, and always in tests.
ROUGH_CONE        Tolerance from which Newton's method, which is far cheaper, converges if every edge is stressed.
                  Positive tensions in balance at the right lengths prove that every edge is.

Onset of rigidity
FLOPPY_CONE       Tolerance of the program that shows the start to be floppy, by coordinates with all |L| < ℓ: up to
                  N_v = 10,000 these are accurate to 1e-3, and a second program is rarely needed.
ONSET_CONE        Tolerance of the last program: tensions and slack are then known to about its root.
ONSET_GAP         Largest gap of the bounds on a strain with status `ok`, relative to 1 + |γ|.
RETREATS          Relative decreases of the lengths that show a strain to be floppy where rounding alone is not enough.
ONSET_ROUNDS      Attempts to separate taut from slack edges; standard networks need one, diluted lattices up to four.
DAMPING           Compliance of taut edges with several self-stresses, relative to their stress, far from the solution.
WEAK_GROWTH       Factor between the stresses below which edges are released when Newton's method fails again.
ONSET_STEPS       Steps of Newton's method in one attempt; convergence is quadratic.
VIOLATED          Excess of |L|/ℓ over 1 of a slack edge that becomes a candidate; errors of the program are smaller.
CENTRAL_START     σ h of an edge at the start of a central path, relative to ⟨σ⟩⟨ℓ²⟩: that where cone programs end.
CENTRAL_END       The same at its end: stresses above 1e-8 of the mean are separated from slack.
CENTRAL_DECREASE  Factor of the mean σ h in one step.
CENTRAL_FITTED    Relative error of ½|L|² + h at which it ends.
CENTRAL_STEPS     Steps of Newton's method on it; ten to twenty are needed.
TO_BOUNDARY       Part of the step to a vanishing stress or slack.
NEARBY            Step of the strain, relative to 1 + |s|, after which the next program is the last one.
MOST_PROGRAMS     Linear programs on one path; smooth paths need two to four.
FLAT_STEPS        Programs in a row that end beyond a flat cell, after which the path counts as floppy to its end.
FLAT              Relative distance from a flat cell, det F = 0, that counts as flat.
INSIDE            Part of the distance to a limit that a step uses, to stay inside.

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

NO_STRESS = 1e-9
WEAK_STRESS = 1e-5
NO_SIGNED_STRESS = 1e-7
FADED = 1e-12
MODERATE = 3.0
UNRESOLVED_STRESS = 1e-20
COLLAPSING = 1e-4
TENSE = 0.01
GAINING = 0.1
SOUND = 1e-2
NO_LENGTH = 1e-10
UNRESOLVED_LENGTH = 1e-8
SOLVED = 1e-6
FITTED = 1e-9
EVEN = 0.12
BALANCED = 1e-8
ISOTROPIC = 1e-14
CONVERGED_REST = 1e-3
STATIONARY = 1e-8
NEARLY_SINGULAR = 1e-9
TRAPPED = 20
DIFFERENCE = 1e-5
FLAT_TRIANGLE = 1e-12
RANK = 1e-9
SELF_STRESS_SHIFT = 1e-12
BALANCE_SHIFT = 1e-13
EXACT_CONE = (1e-12, 1e-13)
ROUGH_CONE = 1e-6
FLOPPY_CONE = 1e-7
ONSET_CONE = 1e-10
ONSET_GAP = 1e-9
RETREATS = (1e-12, 3e-11, 1e-10, 3e-10)
ONSET_ROUNDS = 16
WEAK_GROWTH = 3.0
DAMPING = 1e-3
ONSET_STEPS = 16
VIOLATED = 1e-8
CENTRAL_START = 1e-9
CENTRAL_END = 1e-17
CENTRAL_DECREASE = 0.1
CENTRAL_FITTED = 1e-13
CENTRAL_STEPS = 30
TO_BOUNDARY = 0.95
NEARBY = 0.01
MOST_PROGRAMS = 24
FLAT_STEPS = 5
FLAT = 1e-9
INSIDE = 0.9

# Steps of the strain protocol, after which it stops: a strain of 20 in the default steps.
STRAIN_STEPS = 2000
