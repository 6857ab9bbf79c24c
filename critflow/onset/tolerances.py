"""Constants of the onset layer that decide, with their reasons.

Stress and tension
NO_STRESS         σ of an edge without tension, in units of ⟨|σ|⟩: rounding of a stress of order one.
WEAK_STRESS       σ below which the weakest edges are released first when Newton's method fails, in units of ⟨σ⟩; it
                  grows from one attempt to the next.

Rest lengths
SOLVED            Relative residual of a Newton step that determines the error of its start.
FITTED            Relative error of the lengths of a solution of Newton's method; short edges limit it by rounding.
EVEN              Spread of the logarithms of rest lengths below which few networks have slack edges.
BALANCE_SHIFT     Shift of the Hessian of unit springs, relative to ⟨|L|²⟩, that removes the zero modes of any geometry.
STRAIN_STEPS      Steps of the strain protocol, after which it stops: a strain of 20 in the default steps.

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
NARROW            det F of a cell with free sides at which an onset without bounds is that of a flat cell: the program
                  with ROUGH_CONE leaves a tilt of about its root.
INSIDE            Part of the distance to a limit that a step uses, to stay inside.
"""

NO_STRESS = 1e-9
WEAK_STRESS = 1e-5

SOLVED = 1e-6
FITTED = 1e-9
EVEN = 0.12
BALANCE_SHIFT = 1e-13
STRAIN_STEPS = 2000

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
NARROW = 0.02
INSIDE = 0.9
