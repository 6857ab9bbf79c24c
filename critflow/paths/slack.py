"""Slack cables on a path: floppy vertices, which no taut edge meets, are placed where no cable near them is tight.

Nothing determines these coordinates.  But relaxation leaves an edge that was longer than ℓ at |L| = ℓ to rounding, on
the kink of its energy, where the next iteration cannot tell whether it resists: with all slack edges inside, |L| < ℓ,
floppy vertices feel no force at all, and those of the taut part have a positive definite Hessian.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from critflow.networks.network import Array
from critflow.solvers.cone import fit_lengths
from critflow.springs.state import SpringState

NO_TENSION = 1e-9  # σ of an edge that counts as slack, in units of the largest
TIGHT = 0.999  # |L|/ℓ of a slack edge above which its floppy ends are placed anew
PLACED = 1e-8  # tolerance of the cone program: any place inside will do


def with_slack_placed(springs: SpringState, sigma: Array) -> SpringState:
    """The springs with floppy vertices at min max |L|/ℓ over the slack edges that meet them, by one cone program.

    sigma  (N_b,) that tells taut from slack edges
    """
    network, taut = springs.network, sigma > NO_TENSION * sigma.max()
    held = np.zeros(network.n_vertices, bool)
    held[network.edges[taut]] = True
    floppy = network.free[~held[network.free]]
    g = sp.csr_array(network.free_incidence[:, ~held[network.free]])
    edges = np.diff(g.indptr) > 0
    ratio = springs.lengths[edges] / springs.rest_lengths[edges]
    if not len(floppy) or not ratio.max(initial=0.0) > TIGHT:
        return springs
    g = sp.csr_array(g[edges])
    offsets = springs.bond_vectors[edges] - g @ springs.coordinates[floppy]
    fit = fit_lengths(g, offsets, springs.rest_lengths[edges], PLACED)
    if not fit.ratio < ratio.max():
        return springs
    x, L = springs.coordinates.copy(), springs.bond_vectors.copy()
    x[floppy], L[edges] = fit.coordinates, offsets + g @ fit.coordinates
    return replace(springs, coordinates=x, bond_vectors=L)
