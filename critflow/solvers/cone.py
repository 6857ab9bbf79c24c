"""Lengths or perimeters proportional to given ones as a cone program, with the tensions as its multipliers.

Minimise t subject to |L_α(x)| ≤ t ℓ_α for each edge, or to Σ_{α∈c} |L_α(x)| ≤ t p_c for each cell.  The problem is
convex, so its answer is global.  If all multipliers are positive the configuration is the only all-tension one with
those ratios; an edge, or cell, without tension is slack.
"""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from critflow.linalg.saddle import Saddle
from critflow.networks.network import Array, Network
from critflow.precision.double_double import (
    divide,
    dot,
    extended,
    multiply,
    scaled,
    subtract,
    total,
    two_product,
)
from critflow.precision.geometry import ExtendedGeometry

# Relative residual of a Newton step that is known well enough to measure a distance.
_SOLVED = 1e-6


@dataclass(frozen=True, eq=False)
class ConeSolution:
    """Coordinates (N_v, d), stresses σ ≥ 0 (N_b,), the ratio t; multipliers of the edges or cells, and which have one.

    Multipliers are tensions of the edges or of the cells, of a common scale with σ|L|.
    """

    coordinates: Array
    sigma: Array
    ratio: float
    multipliers: Array
    stressed: NDArray[np.bool_]
    solved: bool
    iterations: int


def fit_lengths(network: Network, lengths: Array, tolerance: float) -> ConeSolution:
    """Solve the cone program for lengths ℓ (N_b,) by Clarabel's interior-point method, to about √tolerance."""
    # One cone (t ℓ_α, L_α) an edge, for the unknowns (x, t).
    x, (ratio,), tension, _, solved, iterations = _solve(network, sp.csc_array(lengths[:, None]), None, tolerance)
    length = np.linalg.norm(network.bond_vectors(x), axis=1)
    stressed = _has_tension(tension, length / (ratio * lengths))
    return ConeSolution(x, tension / length, ratio, tension, stressed, solved, iterations)


def fit_perimeters(network: Network, sides: sp.csr_array, perimeters: Array, tolerance: float) -> ConeSolution:
    """Solve the cone program for perimeters p (N_c,) of cells, their sides being a matrix A ≥ 0 (N_c, N_b)."""
    # One cone (s_α, L_α) an edge and one row t p_c − Σ A s ≥ 0 a cell, for the unknowns (x, s, t).
    m = network.n_edges
    extents = sp.hstack([sp.eye_array(m), sp.csc_array((m, 1))])
    limits = sp.hstack([-sides, perimeters[:, None]])
    x, (*_, ratio), tension, multipliers, solved, iterations = _solve(network, extents, limits, tolerance)
    length = np.linalg.norm(network.bond_vectors(x), axis=1)
    stressed = _has_tension(multipliers, sides @ length / (ratio * perimeters))
    sigma = tension / np.maximum(length, np.finfo(float).tiny)
    return ConeSolution(x, sigma, ratio, multipliers, stressed, solved, iterations)


def _has_tension(multipliers: Array, filled: Array) -> NDArray[np.bool_]:
    """Strict complementarity: tension or room to spare, whichever is the larger part of its scale."""
    return multipliers / multipliers.mean() > 1 - filled


def _solve(
    network: Network, extents: sp.sparray, limits: sp.sparray | None, tolerance: float
) -> tuple[Array, Array, Array, Array, bool, int]:
    """Minimise the last of the unknowns y subject to |L_α(x)| ≤ (extents y)_α and limits y ≥ 0.

    Returns coordinates, y, the multipliers of the edges and of the limits, whether it was solved, iterations.
    """
    d, n, m = network.dimension, len(network.free), network.n_edges
    g, y = network.free_incidence.tocoo(), extents.tocoo()
    block, size = d + 1, d * n + extents.shape[1]
    # Clarabel wants b − A z in the cones, for z = (x, y).
    rows, cols, values = [block * y.row], [d * n + y.col], [-y.data]
    for axis in range(d):
        rows.append(block * g.row + 1 + axis)
        cols.append(d * g.col + axis)
        values.append(-g.data)
    cones = [clarabel.SecondOrderConeT(block)] * m
    n_limits = 0
    if limits is not None:
        least, n_limits = limits.tocoo(), limits.shape[0]
        rows, cols, values = [*rows, block * m + least.row], [*cols, d * n + least.col], [*values, -least.data]
        cones.append(clarabel.NonnegativeConeT(n_limits))
    A = sp.csc_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(cols))), shape=(block * m + n_limits, size)
    )
    b = np.zeros((m, block))
    b[:, 1:] = network.boundary_vectors
    cost = np.zeros(size)
    cost[-1] = 1.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    # One thread, so one order of the sums and one answer.
    settings.max_threads = 1
    # In the plane factors stay so sparse that blocks of columns, which are several times faster in space, do not pay.
    settings.direct_solve_method = "qdldl" if d == 2 else "auto"
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    right = np.concatenate([b.ravel(), np.zeros(n_limits)])
    answer = clarabel.DefaultSolver(sp.csc_matrix((size,) * 2), cost, A, right, cones, settings).solve()

    z, multipliers = np.array(answer.x), np.array(answer.z)
    tension = multipliers[: block * m].reshape(m, block)[:, 0]
    solved = answer.status in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)
    x = network.all_coordinates(z[: d * n].reshape(n, d))
    return x, z[d * n :], tension, multipliers[block * m :], solved, answer.iterations


def polish(
    saddle: Saddle, network: Network, lengths: Array, coordinates: Array, sigma: Array, max_steps: int = 12
) -> tuple[Array, Array, float, int]:
    """Newton on the optimality conditions gᵀ(σ ∘ L) = 0, |L|² = λ ℓ²: from solver accuracy to rounding.

    All edges are stressed.  Returns coordinates, σ, the largest relative error of the lengths and the steps taken.
    """
    target = 0.5 * lengths**2
    x = coordinates.copy()
    best = (x, sigma, np.inf, 0)
    for step in range(max_steps + 1):
        L = network.bond_vectors(x)
        h = 0.5 * np.sum(L**2, axis=1)
        scale = float(sigma @ h / (sigma @ target))
        # What is left: forces relative to tensions, and lengths relative to their targets.
        force = network.divergence @ (sigma[:, None] * L)
        error = max(
            float(np.abs(h / (scale * target) - 1).max()) / 2,
            float(np.abs(force).max() / np.mean(np.abs(sigma) * np.sqrt(2 * h))),
        )
        last = not error < 0.5 * best[2]
        # Of two whose residuals are rounding the later one is closer, since soft modes hardly show in residuals.
        if error < 2 * best[2]:
            best = (x, sigma, error, step)
        if last:
            break
        u, change = saddle.factorize(sigma, L).solve_bordered(-force, scale * target - h, target)
        x, sigma = x.copy(), sigma + change
        x[network.free] += u
    return best


def distance(saddle: Saddle, network: Network, lengths: Array, coordinates: Array, sigma: Array) -> float:
    """How far the coordinates are from those that balance with lengths ∝ ℓ exactly: the largest component.

    It is one more step of Newton's method, from residuals in extended precision; all edges are stressed.
    """
    geometry, stress = ExtendedGeometry(network), extended(sigma)
    L = geometry.bond_vectors(extended(coordinates[network.free]), network.boundary_vectors)
    twice_h = dot(L, L)
    target = two_product(lengths, lengths)
    # The second equation is consistent for one ratio only, which needs as many digits as the rest.
    had, wanted = (total(multiply(stress, sizes)) for sizes in (twice_h, target))
    left = 0.5 * subtract(multiply(divide(had, wanted), target), twice_h).high
    force = geometry.divergence(scaled(stress, L)).high
    # Residuals are solved for as if they were large: their own scale is that of rounding.
    size = float(max(np.abs(left).max(), np.abs(force).max()))
    if size == 0.0:
        return 0.0
    u, _, residual = saddle.factorize(sigma, L.high).solve(-force / size, left / size)
    return size * float(np.abs(u).max()) if residual < _SOLVED else np.nan
