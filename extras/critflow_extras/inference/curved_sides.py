"""Tensions and pressures whose configuration is nearest to traced positions: least squares, errors, sides.

    minimise  D = (1/s²) Σ_i |x_i + δ_i − x̂_i|²   subject to   A(x)(σ, p) + M δ = 0

with the forces A(x)(σ, p) = gᵀ(σ ∘ L) + ½ i |g|ᵀ(q ∘ L), q = J p, and their derivative by positions M = P + iQ as real
2 × 2 blocks.  Each step is one sparse saddle system.  Where three edges meet at each vertex (σ, p) has, but for scale
and common pressure, as many components as the positions, and D is zero.  A vertex on a side, of two edges, adds two
coordinates and one stress: its side is the arc of a circle (Young and Laplace), along which the force at both ends of
each edge, √(τ² + (q|L|/2)²), is one tension.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.linalg import SuperLU, splu

from critflow.arguments import integers
from critflow.checks import components
from critflow.networks import Array, IntArray, Network
from critflow.result import InputError
from critflow.sparse import spread_columns

_COLUMNS = 256  # right sides of one solve


class PositionFit:
    """The least-squares problem of one network and its pressure jumps J, with u = (σ, p).

    freedom  degrees of freedom: coordinates less components of (σ, p) that they determine

    Raises `InputError` where the coordinates are fewer, and where there is no cell.
    """

    def __init__(self, network: Network, jumps: sp.csr_array):
        self.network, self.jumps = network, jumps
        m, n_faces = jumps.shape
        if n_faces == 0:
            raise InputError(
                "no edges close a cell, so no pressure is known: trace whole cells, or leave out pressures=True"
            )
        # Σσ is fixed, and Σp of a periodic network.
        sums = np.repeat([1.0, 0.0], [m, n_faces])
        self.gauges = sp.csr_array(np.array([sums] if network.pins else [sums, 1 - sums]))
        self.scale = np.array([float(m), 0.0])[: self.gauges.shape[0]]
        self.freedom = 2 * len(network.free) + self.gauges.shape[0] - m - n_faces
        if self.freedom < 0:
            raise InputError(
                f"{2 * len(network.free)} coordinates do not determine {m} tensions and {n_faces} pressures, which "
                "needs three edges at each free vertex, or two on traced sides: trace the sides, or leave out "
                "pressures=True"
            )

    @cached_property
    def _moved(self) -> sp.csr_array:
        return self.network.free_incidence if self.network.pins else self.network.incidence

    def forces(self, L: Array) -> sp.csr_array:
        """A (2 n_free, N_b + N_f): unbalanced forces, by vertex and axis, of (σ, p)."""
        spread = abs(self.network.divergence)
        pushed = sp.vstack([spread @ sp.diags_array(half) @ self.jumps for half in (-0.5 * L[:, 1], 0.5 * L[:, 0])])
        return sp.csr_array(
            sp.hstack([spread_columns(self.network, L).T, sp.csr_array(pushed)[_by_vertex(pushed.shape[0])]])
        )

    def _response(self, u: Array) -> sp.csr_array:
        """M (2 n_free, 2 n): derivative of the forces by the positions that were observed, by vertex and axis."""
        m = self.network.n_edges
        pulled = self.network.divergence @ sp.diags_array(u[:m]) @ self._moved
        pushed = 0.5 * abs(self.network.divergence) @ sp.diags_array(self.jumps @ u[m:]) @ self._moved
        blocks = sp.csr_array(sp.block_array([[pulled, -pushed], [pushed, pulled]]))
        return sp.csr_array(blocks[_by_vertex(blocks.shape[0])][:, _by_vertex(blocks.shape[1])])

    def least_forces(self, L: Array) -> Array:
        """(σ, p) of the least unbalanced forces at bond vectors L, zero where three edges meet at each vertex.

        Raises `InputError` where these leave a component of (σ, p) undetermined.
        """
        A, G = self.forces(L), self.gauges
        rows = (
            [[A], [G]]
            if self.freedom == 0
            else [[sp.eye_array(A.shape[0]), A, None], [A.T, None, G.T], [None, G, None]]
        )
        right = np.zeros(sum(self.jumps.shape) + (self.freedom > 0) * (A.shape[0] + G.shape[0]))
        right[len(right) - G.shape[0] :] = self.scale
        try:
            solution = splu(sp.csc_array(sp.block_array(rows))).solve(right)
        except RuntimeError:  # an exact zero pivot
            raise InputError(
                "forces at these positions leave a tension or pressure undetermined: trace the sides of its cell, or "
                "leave out pressures=True"
            ) from None
        return np.asarray(solution[: A.shape[1]] if self.freedom == 0 else solution[A.shape[0] :][: A.shape[1]])

    def saddle(self, L: Array, u: Array) -> SuperLU:
        """The factor of [[1, 0, Mᵀ, 0], [0, 0, Aᵀ, Gᵀ], [M, A, 0, 0], [0, G, 0, 0]], with rows G of the gauges."""
        A, M, G = self.forces(L), self._response(u), self.gauges
        unit = sp.eye_array(M.shape[1])
        rows = [[unit, None, M.T, None], [None, None, A.T, G.T], [M, A, None, None], [None, G, None, None]]
        return splu(sp.csc_array(sp.block_array(rows)))

    def step(self, L: Array, u: Array, apart: Array) -> tuple[Array, float]:
        """(σ, p) of the least |x + δ − x̂|² to first order, at L and u, from x + c − x̂ (n, 2), and what it gains."""
        factor = self.saddle(L, u)
        right = np.zeros(factor.shape[0])
        right[: apart.size] = -apart.ravel()
        right[len(right) - len(self.scale) :] = self.scale
        solution = factor.solve(right)
        left = apart.ravel() + solution[: apart.size]
        return solution[apart.size : apart.size + len(u)], float(np.sum(apart**2) - left @ left)

    def spread(self, L: Array, u: Array, by_L: sp.csr_array, by_u: sp.csr_array) -> Array:
        """Derivatives (2 n, rows) by the observed positions of functions, from theirs by L (rows, 2 N_b) and by u.

        L is ordered by axis and edge.  Independent errors s give the functions a covariance s² times the product of
        these.
        """
        factor, n = self.saddle(L, u), 2 * self._moved.shape[1]
        moved = sp.csr_array(sp.block_diag([self._moved, self._moved]))[:, _by_vertex(n)]
        rows = sp.csr_array(sp.hstack([by_L @ moved, by_u]))
        found = np.empty((n, rows.shape[0]))
        for first in range(0, rows.shape[0], _COLUMNS):
            part = rows[first : first + _COLUMNS]
            right = np.zeros((factor.shape[0], part.shape[0]))
            right[: rows.shape[1]] = part.T.toarray()
            found[:, first : first + _COLUMNS] = factor.solve(right)[:n]
        return found


def sides_of(network: Network, given: ArrayLike | None) -> IntArray:
    """The side of each edge (N_b,): edges that a free vertex of two edges joins have one tension.

    Raises `InputError` for numbers that are not such sides.
    """
    degree = np.bincount(network.edges.ravel(), minlength=network.n_vertices)
    inner = degree == 2
    inner[list(network.pins)] = False
    edge, end = np.nonzero(inner[network.edges])
    links = np.column_stack([edge, network.n_edges + network.edges[edge, end]])
    found = components(links, network.n_edges + network.n_vertices)[: network.n_edges]
    numbers = found if given is None else integers(given, "sides")
    if numbers.shape != found.shape:
        raise InputError(f"sides must have one whole number for each of the {len(found)} edges, not {numbers.shape}")
    pairs = np.unique(np.column_stack([found, numbers]), axis=0)
    for column, told in (
        (0, "one side at vertices of two edges, which have one tension: give them one number"),
        (1, "two sides with a vertex of three edges between, which have two tensions: give them two"),
    ):
        values, first = np.unique(pairs[:, column], return_index=True)
        if len(values) < len(pairs):
            twice = pairs[np.setdiff1d(np.arange(len(pairs)), first)[0], column]
            a, b = pairs[pairs[:, column] == twice][:2]
            edges = sorted(int(np.flatnonzero((found == row[0]) & (numbers == row[1]))[0]) for row in (a, b))
            raise InputError(f"edges {edges[0]} and {edges[1]} are of {told}")
    return np.unique(numbers, return_inverse=True)[1].ravel()


def arc_tensions(fit: PositionFit, u: Array, L: Array, sides: IntArray) -> Array:
    """T = ±√(τ² + (q|L|/2)²) of each side, equal on all edges of it: their mean."""
    sigma, q = u[: len(sides)], fit.jumps @ u[len(sides) :]
    forces = np.copysign(np.hypot(sigma, q / 2), sigma) * np.linalg.norm(L, axis=1)
    return np.bincount(sides, forces) / np.bincount(sides)


def standard_errors(fit: PositionFit, u: Array, L: Array, sides: IntArray) -> tuple[Array, Array]:
    """Those of u at fixed Σσ, and of T of each side over |T| at a fixed mean, both for s = 1."""
    m, length = len(sides), np.linalg.norm(L, axis=1)
    sigma, q = u[:m], fit.jumps @ u[m:]
    force = np.copysign(np.hypot(sigma, q / 2), sigma)
    mean = sp.csr_array((1 / np.bincount(sides)[sides], (sides, np.arange(m))))
    by_L = sp.hstack([mean @ sp.diags_array(force * along / length) for along in L.T])
    by_q = mean @ sp.diags_array(length * q / (4 * force)) @ fit.jumps
    by_u = sp.hstack([mean @ sp.diags_array(length * sigma / force), by_q])
    of_u = fit.spread(L, u, sp.csr_array((len(u), 2 * m)), sp.eye_array(len(u)))
    of_T, T = fit.spread(L, u, by_L, by_u), arc_tensions(fit, u, L, sides)
    relative = of_T / T - of_T.sum(axis=1)[:, None] / T.sum()
    return np.linalg.norm(of_u, axis=0), np.linalg.norm(relative, axis=0)


def _by_vertex(n: int) -> IntArray:
    """The order by vertex and axis of n components that are ordered by axis and vertex."""
    return np.arange(n).reshape(2, -1).T.ravel()
