"""Local responses in 60 digits, from dense bordered matrices: no code shared with critflow."""

import numpy as np

from workflows.benchmarks.high_precision import numbers, precise, roots, solve, zeros
from workflows.benchmarks.reference import configuration, incidence, laplacian


@precise
def exact_strains(network, sigma, source, targets):
    """η of targets, the stiffness of the source and dη/dt, at a stress σ (N_b,): pairs (tail, head, image)."""
    critical, g = configuration(network, sigma), incidence(network)
    L, s, d = critical.bond_vectors, critical.sigma, network.dimension
    n, m = g.shape[1] * d, len(L)
    R = (g[:, :, None] * L[:, None, :]).reshape(m, n)
    rows = [difference(network, critical.coordinates, pair) for pair in (source, *targets)]
    matrix, right = zeros(n + m + 1, n + m + 1), zeros(n + m + 1, len(rows))
    matrix[:n, :n] = laplacian(network, s, d)
    matrix[:n, n : n + m], matrix[n : n + m, :n] = R.T, R
    matrix[n : n + m, -1] = matrix[-1, n : n + m] = s
    right[:n] = np.array([a for a, _ in rows]).T
    solution = solve(matrix, right)
    compliance, multipliers = (right[:n].T @ solution[:n])[:, 0], solution[n : n + m].T
    # Edges yield, and the multipliers are those of least energy.
    yielding = (L * L).sum(axis=1) / numbers(network.stiffness)
    along = (multipliers @ (yielding * s)) / (s @ (yielding * s))
    multipliers = multipliers - along[:, None] * s
    growth = multipliers @ (yielding * multipliers[0])
    ratio = rows[0][1] / np.array([length for _, length in rows[1:]])
    eta = ratio * compliance[1:] / compliance[0]
    return eta, 1 / compliance[0], (ratio * growth[1:] - eta * growth[0]) / compliance[0]


def difference(network, x, pair):
    """a over the free coordinates, (n_free d,), and |r| of a pair."""
    if len(pair) == 2:
        return motion(network, *pair)
    tail, head, image = pair
    r = x[head] - x[tail] + (0 if network.cell is None else numbers(image) @ numbers(network.cell))
    length = roots((r * r).sum())
    a = zeros(network.n_vertices, network.dimension)
    a[head], a[tail] = r / length, -r / length
    return a[network.free].ravel(), length


def motion(network, vertex, direction):
    """The same of a vertex along a unit vector, relative to the mean where nothing is pinned; its length is 1."""
    a = zeros(network.n_vertices, network.dimension)
    a[vertex] = numbers(direction)
    if not network.pins:
        a = a - a.sum(axis=0) / network.n_vertices
    return a[network.free].ravel(), numbers(1)
