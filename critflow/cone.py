"""Lengths proportional to given ones as a cone program: minimise t subject to |L_α(x)| ≤ t ℓ_α.

The problem is convex, so its answer is global, and its multipliers are the tensions.  If all are positive the
configuration is the only all-tension one with those length ratios; an edge without tension is slack.
"""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from critflow.linalg import Saddle
from critflow.network import Array, Network


@dataclass(frozen=True, eq=False)
class ConeSolution:
    """Coordinates (N_v, d), stresses σ ≥ 0 (N_b,), the ratio t and which edges are stressed."""

    coordinates: Array
    sigma: Array
    ratio: float
    stressed: NDArray[np.bool_]
    solved: bool
    iterations: int


def fit_lengths(network: Network, lengths: Array, tolerance: float) -> ConeSolution:
    """Solve the cone program for lengths ℓ (N_b,) by Clarabel's interior-point method, to about √tolerance."""
    d, n, m = network.dimension, len(network.free), network.n_edges
    g = network.free_incidence.tocoo()
    block = d + 1
    # One cone (t ℓ_α, L_α) an edge; Clarabel wants b − A z in the cone, for z = (x, t).
    rows, cols, values = [block * np.arange(m)], [np.full(m, d * n)], [-lengths]
    for axis in range(d):
        rows.append(block * g.row + 1 + axis)
        cols.append(d * g.col + axis)
        values.append(-g.data)
    A = sp.csc_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(cols))), shape=(block * m, d * n + 1)
    )
    b = np.zeros((m, block))
    b[:, 1:] = network.boundary_vectors
    cost = np.zeros(d * n + 1)
    cost[-1] = 1.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    cones = [clarabel.SecondOrderConeT(block)] * m
    answer = clarabel.DefaultSolver(sp.csc_matrix((d * n + 1,) * 2), cost, A, b.ravel(), cones, settings).solve()

    z = np.array(answer.x)
    x, ratio = network.all_coordinates(z[:-1].reshape(n, d)), float(z[-1])
    tension = np.array(answer.z).reshape(m, block)[:, 0]
    length = np.linalg.norm(network.bond_vectors(x), axis=1)
    # Strict complementarity: an edge has either tension or room to spare, whichever is the larger part of its scale.
    stressed = tension / tension.mean() > 1 - length / (ratio * lengths)
    solved = answer.status in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)
    return ConeSolution(x, tension / length, ratio, stressed, solved, answer.iterations)


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
        if not error < 0.5 * best[2]:
            break
        best = (x, sigma, error, step)
        # The stress is the matrix' left null vector at the solution; `scale` makes the second equation consistent.
        u, change, _ = saddle.factorize(sigma, L).solve(-force, scale * target - h)
        change -= (change @ sigma) / (sigma @ sigma) * sigma
        x, sigma = x.copy(), sigma + change
        x[network.free] += u
    return best
