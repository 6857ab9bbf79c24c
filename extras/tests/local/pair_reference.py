"""Local responses in 60 digits, from dense bordered matrices: no code shared with critflow."""

import numpy as np

from workflows.benchmarks.high_precision import numbers, precise, roots, solve, zeros
from workflows.benchmarks.reference import configuration, incidence, laplacian


@precise
def exact_strains(network, sigma, source, targets):
    """η of targets and the stiffness of the source at a stress σ (N_b,): pairs (tail, head, image)."""
    critical, g = configuration(network, sigma), incidence(network)
    L, s, d = critical.bond_vectors, critical.sigma, network.dimension
    n, m = g.shape[1] * d, len(L)
    R = (g[:, :, None] * L[:, None, :]).reshape(m, n)
    rows = [difference(network, critical.coordinates, pair) for pair in (source, *targets)]
    matrix = zeros(n + m + 2, n + m + 2)
    matrix[:n, :n] = laplacian(network, s, d)
    matrix[:n, n : n + m], matrix[n : n + m, :n] = R.T, R
    matrix[n : n + m, -2] = matrix[-2, n : n + m] = s
    matrix[:n, -1] = matrix[-1, :n] = rows[0][0]
    right = zeros(n + m + 2, 1)
    right[-1] = 1
    solution = solve(matrix, right)[:, 0]
    length = rows[0][1]
    return np.array([a @ solution[:n] * length / r for a, r in rows[1:]], dtype=object), -solution[-1]


def difference(network, x, pair):
    """a over the free coordinates, (n_free d,), and |r| of a pair."""
    tail, head, image = pair
    r = x[head] - x[tail] + (0 if network.cell is None else numbers(image) @ numbers(network.cell))
    length = roots((r * r).sum())
    a = zeros(network.n_vertices, network.dimension)
    a[head], a[tail] = r / length, -r / length
    return a[network.free].ravel(), length
