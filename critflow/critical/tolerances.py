"""Constants of the critical manifold that decide, with their reasons.

COLLAPSED        An edge shorter than this part of the mean length has collapsed: its direction, and what follows from
                 it, has half of its digits or fewer.
CONDENSED_EDGES  Number of edges from which systems of stresses and displacements are cheaper condensed than as saddle
                 matrices, for stresses that are all positive.
SCALED           A stress with Σσ² = N_b to this relative accuracy counts as scaled and keeps its digits: the sum of
                 squares is rounded by a few EPS.
SOFTNESS         Softnesses of the edges, relative to that of the prestress, at which determinants are extrapolated to
                 zero softness, in turn until one is below all radii: the extrapolation error is of third order,
                 rounding goes as EPS/SOFTNESS.
UNCERTAIN_LOGARITHM
                 Error of log|K| from which K, and the signs of curvatures, are not certain.
DENSE_SADDLE     Rows of a saddle matrix whose determinant is found by a dense factorisation: below a second.
ARTEFACT         Relative residual under B of a radius that B does not have: that of a null direction is 1.
CURVATURE_ERROR  Largest relative residual of principal curvatures that are returned.
FLAT             Eigenvalues of a stress Hessian below this part of the largest are zero; rounding leaves about 1e-13.
DENSE_BYTES      Largest dense matrix of an operator, in bytes: 10,000 rows and columns take 0.8 GB.
DENSE_EDGES      Most edges for all eigenvalues of a stress Hessian: 32 MB and some seconds.
"""

from __future__ import annotations

COLLAPSED = 1e-8
CONDENSED_EDGES = 100_000
SCALED = 4e-15
SOFTNESS = (1e-6, 1e-8, 1e-10)
UNCERTAIN_LOGARITHM = 0.1
DENSE_SADDLE = 1000
ARTEFACT = 0.5
CURVATURE_ERROR = 1e-8
FLAT = 1e-9
DENSE_BYTES = 10**9
DENSE_EDGES = 2000
