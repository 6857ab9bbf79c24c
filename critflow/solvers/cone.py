"""Lengths, perimeters and strains of cables as cone programs, with the tensions as their multipliers.

Minimise t subject to |L_α(x)| ≤ t ℓ_α for each edge, or to Σ_{α∈c} |L_α(x)| ≤ t p_c for each cell, with bond vectors
L = g x + b.  The problem is convex, so its minimum is global.  If all multipliers are positive the configuration is the
only all-tension one with those ratios; an edge, or cell, without tension is slack.

Where the boundary moves linearly, L = g x + b + Σ_k b'_k y_k, the largest y_k that cables of lengths ℓ permit is such a
program too: maximise y_k subject to |L_α(x, y)| ≤ ℓ_α.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import clarabel
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
# Length below which tension per length would overflow.
_NO_LENGTH = 1e-150
Outcome = Literal["solved", "unbounded", "infeasible", "stalled"]


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
    parameters   y of the boundary, (k,)
    """

    coordinates: Array
    sigma: Array
    ratio: float
    multipliers: Array
    stressed: NDArray[np.bool_]
    solved: bool
    steps: int
    parameters: Array = field(default_factory=lambda: np.zeros(0))


class Reach(NamedTuple):
    """The farthest boundary that cables permit.

    coordinates  x of the free vertices, (n, d)
    parameters   y, (k,)
    tensions     multipliers of the edges, (N_b,)
    taut         edges (N_b,) under tension
    outcome      "solved", "unbounded" (any y), "infeasible" (no y), or "stalled" (by rounding)
    steps        interior-point iterations
    """

    coordinates: Array
    parameters: Array
    tensions: Array
    taut: NDArray[np.bool_]
    outcome: Outcome
    steps: int


class _Program(NamedTuple):
    """Coordinates, further unknowns y, multipliers of the edges and of the limits, outcome and iterations."""

    x: Array
    y: Array
    tension: Array
    multipliers: Array
    outcome: Outcome
    steps: int


def fit_lengths(
    incidence: sp.csr_array, offsets: Array, lengths: Array, tolerance: float, rates: Array | None = None
) -> ConeSolution:
    """Solve the cone program for lengths ℓ (N_b,) by Clarabel's interior-point method, to about √tolerance.

    incidence  g of the free vertices, (N_b, n)
    offsets    b, (N_b, d)
    rates      b'_k of boundary parameters y_k that are unknown too, (k, N_b, d)
    """
    # One cone (t ℓ_α, L_α) an edge, for the unknowns (x, y, t).
    n_rates, unit = 0 if rates is None else len(rates), _unit(lengths)
    extents = sp.hstack([sp.csc_array((len(lengths), n_rates)), sp.csc_array(lengths[:, None] / unit)])
    moved = None if rates is None else rates / unit
    found = _solve(incidence, offsets / unit, _Boundary(moved), extents, None, tolerance)
    found = found._replace(x=unit * found.x)
    ratio, tension = float(found.y[-1]), found.tension
    length = np.linalg.norm(_bond_vectors(incidence, offsets, found, rates), axis=1)
    stressed = _has_tension(tension, length / (ratio * lengths))
    sigma = _stress(tension, length)
    solved = found.outcome == "solved"
    return ConeSolution(found.x, sigma, ratio, tension, stressed, solved, found.steps, found.y[:-1])


def farthest(incidence: sp.csr_array, offsets: Array, rates: Array, lengths: Array, tolerance: float) -> Reach:
    """Maximise the last of the parameters y that cables of lengths ℓ (N_b,) permit, |g x + b + Σ_k b'_k y_k| ≤ ℓ.

    incidence  g of the free vertices, (N_b, n)
    offsets    b, (N_b, d)
    rates      b'_k, (k, N_b, d)
    """
    signs, unit = np.ones(len(rates)), _unit(lengths)
    signs[-1] = -1.0
    # The program minimises the last unknown.
    boundary = _Boundary(signs[:, None, None] * rates / unit, lengths / unit)
    found = _solve(incidence, offsets / unit, boundary, None, None, tolerance)
    found = found._replace(x=unit * found.x, y=signs * found.y)
    return _reach(incidence, offsets, rates, lengths, found)


def nearest(incidence: sp.csr_array, offsets: Array, rates: Array, lengths: Array, tolerance: float) -> Reach:
    """The smallest parameters y, by the largest |y_k|, for which |g x + b + Σ_k b'_k y_k| ≤ ℓ: as `farthest`."""
    # One cone (ℓ_α, L_α) an edge and rows s ± y_k ≥ 0, for the unknowns (x, y, s).
    k, unit = len(rates), _unit(lengths)
    limits = sp.hstack([sp.vstack([sp.eye_array(k), -sp.eye_array(k)]), np.ones((2 * k, 1))])
    with_size = np.concatenate([rates, np.zeros((1, *offsets.shape))])
    found = _solve(incidence, offsets / unit, _Boundary(with_size / unit, lengths / unit), None, limits, tolerance)
    return _reach(incidence, offsets, rates, lengths, found._replace(x=unit * found.x, y=found.y[:k]))


def _reach(incidence: sp.csr_array, offsets: Array, rates: Array, lengths: Array, found: _Program) -> Reach:
    length = np.linalg.norm(_bond_vectors(incidence, offsets, found, rates), axis=1)
    taut = _has_tension(found.tension, length / lengths)
    return Reach(found.x, found.y, found.tension, taut, found.outcome, found.steps)


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
    found = _solve(incidence, offsets, _Boundary(), extents, limits, tolerance)
    ratio, length = float(found.y[-1]), np.linalg.norm(_bond_vectors(incidence, offsets, found), axis=1)
    stressed = _has_tension(found.multipliers, sides @ length / (ratio * perimeters))
    sigma = _stress(found.tension, length)
    return ConeSolution(found.x, sigma, ratio, found.multipliers, stressed, found.outcome == "solved", found.steps)


class _Boundary(NamedTuple):
    """How the boundary enters: rates b'_k (k, N_b, d) of the first unknowns y, and constant limits ℓ (N_b,)."""

    rates: Array | None = None
    lengths: Array | None = None


def _bond_vectors(incidence: sp.csr_array, offsets: Array, found: _Program, rates: Array | None = None) -> Array:
    L = np.asarray(incidence @ found.x) + offsets
    return L if rates is None else L + np.einsum("kad,k->ad", rates, found.y[: len(rates)])


def _unit(lengths: Array) -> float:
    """A power of two near the mean length: tolerances of the program are absolute."""
    return float(2.0 ** np.round(np.log2(lengths.mean())))


def _stress(tension: Array, length: Array) -> Array:
    """Tension per length, (N_b,); zero for edges that collapse, whose direction is not known."""
    return np.divide(tension, length, out=np.zeros_like(length), where=length > _NO_LENGTH)


def _has_tension(multipliers: Array, filled: Array) -> NDArray[np.bool_]:
    """Strict complementarity: tension or slack, whichever is the larger fraction of its scale."""
    return multipliers / multipliers.mean() > 1 - filled


def _solve(
    incidence: sp.csr_array,
    offsets: Array,
    boundary: _Boundary,
    extents: sp.sparray | None,
    limits: sp.sparray | None,
    tolerance: float,
) -> _Program:
    """Minimise the last of the unknowns y subject to |L_α(x, y)| ≤ ℓ_α + (extents y)_α and limits y ≥ 0."""
    (m, n), d = incidence.shape, offsets.shape[1]
    rates = np.zeros((0, m, d)) if boundary.rates is None else boundary.rates
    n_limits = 0 if limits is None else limits.shape[0]
    n_further = max(part.shape[1] for part in (extents, limits, np.empty((0, len(rates)))) if part is not None)
    A = _constraints(incidence, rates, extents, limits, n_further)
    cones: list[object] = [clarabel.SecondOrderConeT(d + 1)] * m
    if n_limits:
        cones.append(clarabel.NonnegativeConeT(n_limits))
    b = np.zeros((m, d + 1))
    b[:, 1:] = offsets
    if boundary.lengths is not None:
        b[:, 0] = boundary.lengths
    cost = np.zeros(d * n + n_further)
    cost[-1] = 1.0
    right = np.concatenate([b.ravel(), np.zeros(n_limits)])
    no_squares = sp.csc_matrix((len(cost),) * 2)
    answer = clarabel.DefaultSolver(no_squares, cost, A, right, cones, _settings(d, tolerance)).solve()
    z, multipliers = np.array(answer.x), np.array(answer.z)
    tension = multipliers[: (d + 1) * m].reshape(m, d + 1)[:, 0]
    outcome = _OUTCOMES.get(str(answer.status), "stalled")
    rest = multipliers[(d + 1) * m :]
    return _Program(z[: d * n].reshape(n, d), z[d * n :], tension, rest, outcome, answer.iterations)


_OUTCOMES: dict[str, Outcome] = {
    "Solved": "solved",
    "AlmostSolved": "solved",
    "DualInfeasible": "unbounded",
    "AlmostDualInfeasible": "unbounded",
    "PrimalInfeasible": "infeasible",
    "AlmostPrimalInfeasible": "infeasible",
}


def _constraints(
    incidence: sp.csr_array, rates: Array, extents: sp.sparray | None, limits: sp.sparray | None, n_further: int
) -> sp.csc_matrix:
    """The matrix A of Clarabel, which requires b − A z in the cones, for z = (x, y)."""
    (m, n), d = incidence.shape, rates.shape[2]
    g, block = incidence.tocoo(), rates.shape[2] + 1
    rows, cols, values = [], [], []
    for axis in range(d):
        rows.append(block * g.row + 1 + axis)
        cols.append(d * g.col + axis)
        values.append(-g.data)
        k, moved = np.nonzero(rates[:, :, axis])
        rows.append(block * moved + 1 + axis)
        cols.append(d * n + k)
        values.append(-rates[k, moved, axis])
    for part, start, step in ((extents, 0, block), (limits, block * m, 1)):
        if part is not None:
            y = part.tocoo()
            rows.append(start + step * y.row)
            cols.append(d * n + y.col)
            values.append(-y.data)
    shape = (block * m + (0 if limits is None else limits.shape[0]), d * n + n_further)
    return sp.csc_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(cols))), shape=shape)


def _settings(dimension: int, tolerance: float) -> clarabel.DefaultSettings:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    # One thread, so one order of the sums and one result.
    settings.max_threads = 1
    # In the plane factors are so sparse that blocks of columns, which are several times faster in space, do not pay.
    settings.direct_solve_method = "qdldl" if dimension == 2 else "auto"
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    return settings
