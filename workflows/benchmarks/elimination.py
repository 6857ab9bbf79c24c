"""A configuration without subtraction, for positive stresses of any range.

Eliminating a vertex leaves edges between its neighbours, of stress σ_ik σ_kj/Σσ_k and bond offset b_ik + b_kj; edges in
parallel merge into one, with the sum of the stresses and the mean of the offsets.  So stresses are only added,
multiplied and divided (Grassmann, Taksar and Heyman, 1985; Alfa, Xue and Ye, 2002), every coordinate is a mean of
others, and no condition number magnifies the rounding.  It is dense, n³ operations.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from critflow import Network
from critflow.networks.network import Array


def subtraction_free_solve(network: Network, sigma: ArrayLike) -> Array:
    """Coordinates (N_v, d) in balance under a positive stress σ (N_b,), each right to some n ε of the cell."""
    n, d = len(network.free), network.dimension
    index = np.full(network.n_vertices, n)  # fixed vertices are one, at the origin: b knows where they are
    index[network.free] = np.arange(n)
    stress, offset = np.zeros((n + 1, n + 1)), np.zeros((n + 1, n + 1, d))
    for (tail, head), s, b in zip(
        index[network.edges], np.asarray(sigma, float), network.boundary_vectors, strict=True
    ):
        if tail == head:
            continue
        for i, j, vector in ((tail, head, b), (head, tail, -b)):
            both = stress[i, j] + s
            if both:
                offset[i, j] += s / both * (vector - offset[i, j])
            stress[i, j] = both
    total = np.zeros(n)
    for k in range(n):
        rest = slice(k + 1, n + 1)
        out = stress[k, rest]
        total[k] = out.sum()
        added = np.outer(out, out / total[k])
        both = stress[rest, rest] + added
        share = np.divide(added, both, out=np.zeros_like(both), where=both > 0)
        path = offset[rest, k][:, None] + offset[k, rest][None, :]
        offset[rest, rest] += share[:, :, None] * (path - offset[rest, rest])
        stress[rest, rest] = both
    x = np.zeros((n + 1, d))
    for k in reversed(range(n)):
        rest = slice(k + 1, n + 1)
        x[k] = (stress[k, rest] / total[k]) @ (x[rest] + offset[k, rest])
    return network.all_coordinates(x[:n])
