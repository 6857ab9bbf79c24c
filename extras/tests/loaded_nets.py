"""Networks under loads with known answers, for the tests of the extras."""

import numpy as np
from scipy.optimize import brentq

from critflow import Network


def rope(n, span, stiffness=1.0):
    """A chain of n edges between pins at the same height, vertices in order."""
    pins = {0: (0.0, 0.0), n: (float(span), 0.0)}
    return Network([[i, i + 1] for i in range(n)], pins=pins, stiffness=stiffness)


def net(n, height=lambda x, y: 0 * x):
    """A square net of n × n squares, its border pinned at a height, and the positions (N_v, 3) on that surface."""
    i, j = np.divmod(np.arange((n + 1) ** 2), n + 1)
    border = (i % n == 0) | (j % n == 0)
    right, up = np.flatnonzero(j < n), np.flatnonzero(i < n)
    edges = np.concatenate([np.column_stack([right, right + 1]), np.column_stack([up, up + n + 1])])
    edges = edges[~border[edges].all(axis=1)]
    x = np.column_stack([i, j, height(i, j)]).astype(float)
    used, edges = np.unique(edges, return_inverse=True)
    pins = {int(k): x[v] for k, v in enumerate(used) if border[v]}
    return Network(edges.reshape(-1, 2), pins=pins, positions=x[used]), x[used]


def catenary(n, span, k, w):
    """σ (n,) and coordinates (n + 1, 2) of springs of rest length 1, stiffness k and weight w in a row.

    Half of each weight acts at each end.  The horizontal force H is the same in all springs, and the vertical one of
    spring i is V_i = w(i − (n − 1)/2), so that a spring of tension T = √(H² + V²) has the length 1 + T/k; H follows
    from the span.
    """
    V = w * (np.arange(n) - (n - 1) / 2)
    steps = lambda H: (1 / np.hypot(H, V) + 1 / k)[:, None] * np.column_stack([np.full(n, H), V])  # noqa: E731
    H = brentq(lambda H: steps(H)[:, 0].sum() - span, 1e-12, 1e6, xtol=1e-300, rtol=1e-15)
    tension = np.hypot(H, V)
    x = np.concatenate([np.zeros((1, 2)), np.cumsum(steps(H), axis=0)])
    return tension / (1 + tension / k), x
