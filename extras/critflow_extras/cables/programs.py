"""Cone programs of a boundary that moves linearly: the largest, and the smallest, parameters that cables permit.

With bond vectors L(x, y) = g x + b + Σ_k b'_k y_k, cables of lengths ℓ permit the coordinates x and parameters y of the
boundary with |L_α(x, y)| ≤ ℓ_α.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from critflow.cones import ConeSolution, solve_cones
from critflow.networks import Array
from critflow.numerics import power_of_two


def farthest(incidence: sp.csr_array, offsets: Array, rates: Array, lengths: Array, tolerance: float) -> ConeSolution:
    """Maximise the last of the parameters y that cables of lengths ℓ (N_b,) permit, |g x + b + Σ_k b'_k y_k| ≤ ℓ.

    incidence  g of the free vertices, (N_b, n)
    offsets    b, (N_b, d)
    rates      b'_k, (k, N_b, d)
    """
    # The program minimises the last unknown.
    signs = np.ones(len(rates))
    signs[-1] = -1.0
    turned = signs[:, None, None] * rates
    turned_back = solve_cones(incidence, offsets, turned, tolerance, power_of_two(lengths.mean()), lengths)[0]
    return replace(turned_back, parameters=signs * turned_back.parameters)


def nearest(incidence: sp.csr_array, offsets: Array, rates: Array, lengths: Array, tolerance: float) -> ConeSolution:
    """The smallest parameters y, by the largest |y_k|, for which |g x + b + Σ_k b'_k y_k| ≤ ℓ: as `farthest`."""
    # One cone (ℓ_α, L_α) an edge and rows s ± y_k ≥ 0, for the unknowns (x, y, s).
    k = len(rates)
    limits = sp.hstack([sp.vstack([sp.eye_array(k), -sp.eye_array(k)]), np.ones((2 * k, 1))])
    return solve_cones(incidence, offsets, rates, tolerance, power_of_two(lengths.mean()), lengths, limits=limits)[0]
