"""Perimeters of faces as a cone program, with the tensions of the faces as its multipliers.

Minimise t subject to Σ_{α∈f} |L_α(x)| ≤ t p_f for each face, with bond vectors L = g x + b.  The problem is convex, so
its minimum is global; a face without tension is slack.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from critflow.cones import ConeSolution, has_tension, solve_cones
from critflow.networks import Array


def fit_perimeters(
    incidence: sp.csr_array, offsets: Array, sides: sp.csr_array, perimeters: Array, tolerance: float
) -> ConeSolution:
    """Solve the cone program for perimeters p (N_f,) of faces, whose sides are a matrix A ≥ 0 (N_f, N_b).

    incidence  g of the free vertices, (N_b, n)
    offsets    b, (N_b, d)
    """
    # One cone (s_α, L_α) an edge and one row t p_c − Σ A s ≥ 0 a face, for the unknowns (x, s, t).
    m, fixed = len(offsets), np.zeros((0, *offsets.shape))
    extents = sp.hstack([sp.eye_array(m), sp.csc_array((m, 1))])
    limits = sp.hstack([-sides, perimeters[:, None]])
    program, of_faces = solve_cones(incidence, offsets, fixed, tolerance, 1.0, extents=extents, limits=limits)
    length = np.linalg.norm(incidence @ program.coordinates + offsets, axis=1)
    stressed = has_tension(of_faces, sides @ length / (program.ratio * perimeters))
    return replace(program, multipliers=of_faces, stressed=stressed)
