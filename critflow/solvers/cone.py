"""Lengths or perimeters proportional to given ones as a cone program, with the tensions as its multipliers.

Minimise t subject to |L_α(x)| ≤ t ℓ_α for each edge, or to Σ_{α∈c} |L_α(x)| ≤ t p_c for each cell, with bond vectors
L = g x + b.  The problem is convex, so its minimum is global.  If all multipliers are positive the configuration is the
only all-tension one with those ratios; an edge, or cell, without tension is slack.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import clarabel
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
# Length below which tension per length would overflow.
_NO_LENGTH = 1e-150


@dataclass(frozen=True, eq=False)
class ConeSolution:
    """Solution of a cone program.

    coordinates  x of the free vertices, (n, d)
    sigma        stresses σ ≥ 0, (N_b,)
    ratio        t
    multipliers  tensions of the edges (N_b,) or of the cells (N_c,), of a common scale with σ|L|
    stressed     edges (N_b,) or cells (N_c,) under tension
    solved       whether the program converged
    steps        interior-point iterations
    """

    coordinates: Array
    sigma: Array
    ratio: float
    multipliers: Array
    stressed: NDArray[np.bool_]
    solved: bool
    steps: int


class _Program(NamedTuple):
    """Coordinates, further unknowns y, multipliers of the edges and of the limits, convergence and iterations."""

    x: Array
    y: Array
    tension: Array
    multipliers: Array
    solved: bool
    steps: int


def fit_lengths(incidence: sp.csr_array, offsets: Array, lengths: Array, tolerance: float) -> ConeSolution:
    """Solve the cone program for lengths ℓ (N_b,) by Clarabel's interior-point method, to about √tolerance.

    incidence  g of the free vertices, (N_b, n)
    offsets    b, (N_b, d)
    """
    # One cone (t ℓ_α, L_α) an edge, for the unknowns (x, t).
    found = _solve(incidence, offsets, sp.csc_array(lengths[:, None]), None, tolerance)
    ratio, tension = float(found.y[0]), found.tension
    length = _lengths(incidence, offsets, found.x)
    stressed = _has_tension(tension, length / (ratio * lengths))
    return ConeSolution(found.x, _stress(tension, length), ratio, tension, stressed, found.solved, found.steps)


def fit_perimeters(
    incidence: sp.csr_array, offsets: Array, sides: sp.csr_array, perimeters: Array, tolerance: float
) -> ConeSolution:
    """Solve the cone program for perimeters p (N_c,) of cells, whose sides are a matrix A ≥ 0 (N_c, N_b).

    incidence  g of the free vertices, (N_b, n)
    offsets    b, (N_b, d)
    """
    # One cone (s_α, L_α) an edge and one row t p_c − Σ A s ≥ 0 a cell, for the unknowns (x, s, t).
    m = len(offsets)
    extents = sp.hstack([sp.eye_array(m), sp.csc_array((m, 1))])
    limits = sp.hstack([-sides, perimeters[:, None]])
    found = _solve(incidence, offsets, extents, limits, tolerance)
    ratio, length = float(found.y[-1]), _lengths(incidence, offsets, found.x)
    stressed = _has_tension(found.multipliers, sides @ length / (ratio * perimeters))
    sigma = _stress(found.tension, length)
    return ConeSolution(found.x, sigma, ratio, found.multipliers, stressed, found.solved, found.steps)


def _lengths(incidence: sp.csr_array, offsets: Array, x: Array) -> Array:
    return np.linalg.norm(np.asarray(incidence @ x) + offsets, axis=1)


def _stress(tension: Array, length: Array) -> Array:
    """Tension per length, (N_b,); zero for edges that collapse, whose direction is not known."""
    return np.divide(tension, length, out=np.zeros_like(length), where=length > _NO_LENGTH)


def _has_tension(multipliers: Array, filled: Array) -> NDArray[np.bool_]:
    """Strict complementarity: tension or slack, whichever is the larger fraction of its scale."""
    return multipliers / multipliers.mean() > 1 - filled


def _solve(
    incidence: sp.csr_array, offsets: Array, extents: sp.sparray, limits: sp.sparray | None, tolerance: float
) -> _Program:
    """Minimise the last of the unknowns y subject to |L_α(x)| ≤ (extents y)_α and limits y ≥ 0."""
    (m, n), d = incidence.shape, offsets.shape[1]
    g, y = incidence.tocoo(), extents.tocoo()
    block, size = d + 1, d * n + extents.shape[1]
    # Clarabel requires b − A z in the cones, for z = (x, y).
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
    b[:, 1:] = offsets
    cost = np.zeros(size)
    cost[-1] = 1.0
    right = np.concatenate([b.ravel(), np.zeros(n_limits)])
    answer = clarabel.DefaultSolver(sp.csc_matrix((size,) * 2), cost, A, right, cones, _settings(d, tolerance)).solve()
    z, multipliers = np.array(answer.x), np.array(answer.z)
    tension = multipliers[: block * m].reshape(m, block)[:, 0]
    solved = answer.status in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)
    return _Program(z[: d * n].reshape(n, d), z[d * n :], tension, multipliers[block * m :], solved, answer.iterations)


def _settings(dimension: int, tolerance: float) -> clarabel.DefaultSettings:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    # One thread, so one order of the sums and one result.
    settings.max_threads = 1
    # In the plane factors are so sparse that blocks of columns, which are several times faster in space, do not pay.
    settings.direct_solve_method = "qdldl" if dimension == 2 else "auto"
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    return settings
