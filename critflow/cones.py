"""Lengths of edges as a cone program, with the tensions as its multipliers.

Minimise t subject to |L_α(x)| ≤ t ℓ_α for each edge, with bond vectors L = g x + b.  The problem is convex, so its
minimum is global.  If all multipliers are positive the configuration is the only all-tension one with those ratios; an
edge without tension is slack.

`solve_cones` solves such programs with further unknowns y and linear limits of them as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import clarabel
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from critflow.arguments import Array
from critflow.manifold import NO_DIRECTION
from critflow.numerics import power_of_two

Outcome = Literal["solved", "unbounded", "infeasible", "stalled"]
_OUTCOMES: dict[str, Outcome] = {"Solved": "solved", "DualInfeasible": "unbounded", "PrimalInfeasible": "infeasible"}


@dataclass(frozen=True, eq=False)
class ConeSolution:
    """Solution of a cone program."""

    coordinates: Array  # x of the free vertices, (n, d)
    parameters: Array  # y of the boundary, (k,)
    sigma: Array  # stresses σ ≥ 0, (N_b,)
    multipliers: Array  # tensions of the edges (N_b,), or of the faces (N_f,), of a common scale with σ|L|
    stressed: NDArray[np.bool_]  # edges (N_b,), or faces (N_f,), under tension
    ratio: float  # t; 1 where the lengths are limits
    outcome: Outcome  # "solved", "unbounded" (any y), "infeasible" (no y), or "stalled" (by rounding)
    steps: int  # interior-point iterations

    @property
    def solved(self) -> bool:
        """Whether the program converged."""
        return self.outcome == "solved"


def fit_lengths(
    incidence: sp.csr_array, offsets: Array, lengths: Array, tolerance: float, rates: Array | None = None
) -> ConeSolution:
    """Solve the cone program for lengths ℓ (N_b,) by Clarabel's interior-point method, to about √tolerance.

    incidence  g of the free vertices, (N_b, n)
    offsets    b, (N_b, d)
    rates      b'_k of boundary parameters y_k that are unknown too, (k, N_b, d)
    """
    # One cone (t ℓ_α, L_α) an edge, for the unknowns (x, y, t).
    rates = np.zeros((0, *offsets.shape)) if rates is None else rates
    extents = sp.hstack([sp.csc_array((len(lengths), len(rates))), sp.csc_array(lengths[:, None])])
    return solve_cones(incidence, offsets, rates, tolerance, power_of_two(lengths.mean()), extents=extents)[0]


def interior_point(
    cost: Array, A: sp.sparray, b: Array, cones: Sequence[object], tolerance: float, method: str = "auto"
) -> Any:
    """Clarabel's solution of the least cost·z with b − A z in the cones, on one thread.

    method  of its linear systems
    """
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    # One thread, so one order of the sums and one result.
    settings.max_threads = 1
    settings.direct_solve_method = method
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    no_squares = sp.csc_matrix((len(cost),) * 2)
    return clarabel.DefaultSolver(no_squares, cost, sp.csc_matrix(A), b, cones, settings).solve()


def has_tension(multipliers: Array, filled: Array) -> NDArray[np.bool_]:
    """Strict complementarity: tension or slack, whichever is the larger fraction of its scale."""
    return multipliers / multipliers.mean() > 1 - filled


def solve_cones(
    incidence: sp.csr_array,
    offsets: Array,
    rates: Array,
    tolerance: float,
    unit: float,
    lengths: Array | float = 0.0,
    extents: sp.sparray | None = None,
    limits: sp.sparray | None = None,
) -> tuple[ConeSolution, Array]:
    """Minimise the last of the unknowns y subject to |L_α(x, y)| ≤ ℓ_α + (extents y)_α and limits y ≥ 0.

    The solution, whose ratio is the last of y where there are extents, and the multipliers of the limits.  Lengths are
    solved for in a unit.
    """
    (m, n), d = incidence.shape, offsets.shape[1]
    n_further = max([len(rates), *(part.shape[1] for part in (extents, limits) if part is not None)])
    # Clarabel requires b − A z in the cones, for z = (x, y).
    g, (k, moved, axis) = incidence.tocoo(), np.nonzero(rates)
    axes = np.arange(d)
    rows = [((d + 1) * g.row[:, None] + 1 + axes).ravel(), (d + 1) * moved + 1 + axis]
    cols = [(d * g.col[:, None] + axes).ravel(), d * n + k]
    values = [np.repeat(-g.data, d), -rates[k, moved, axis] / unit]
    for part, start, step, size in ((extents, 0, d + 1, unit), (limits, (d + 1) * m, 1, 1.0)):
        if part is not None:
            by_y = part.tocoo()
            rows, cols = [*rows, start + step * by_y.row], [*cols, d * n + by_y.col]
            values.append(-by_y.data / size)
    n_limits = 0 if limits is None else limits.shape[0]
    shape = ((d + 1) * m + n_limits, d * n + n_further)
    A = sp.csc_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(cols))), shape=shape)
    cones = [clarabel.SecondOrderConeT(d + 1)] * m + [clarabel.NonnegativeConeT(n_limits)] * (n_limits > 0)
    b = np.zeros(shape[0])
    b[: (d + 1) * m].reshape(m, d + 1)[:] = np.column_stack([np.broadcast_to(lengths, m), offsets]) / unit
    # In the plane factors are so sparse that blocks of columns, which are several times faster in space, do not pay.
    cost = np.append(np.zeros(shape[1] - 1), 1.0)
    answer = interior_point(cost, A, b, cones, tolerance, "qdldl" if d == 2 else "auto")
    z, multipliers = np.array(answer.x), np.array(answer.z)
    x, y = unit * z[: d * n].reshape(n, d), z[d * n :]
    tension, parameters = multipliers[: (d + 1) * m].reshape(m, d + 1)[:, 0], y[: len(rates)]
    length = np.linalg.norm(incidence @ x + offsets + np.einsum("kad,k->ad", rates, parameters), axis=1)
    # Tension per length; zero for edges that collapse, whose direction is not known.
    sigma = np.divide(tension, length, out=np.zeros_like(length), where=length > NO_DIRECTION)
    allowed, ratio = (lengths, 1.0) if extents is None else (extents @ y, float(y[-1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        # Sides of a face may collapse.
        stressed = has_tension(tension, length / allowed)
    outcome = str(answer.status).removeprefix("Almost")
    solved = ConeSolution(
        x, parameters, sigma, tension, stressed, ratio, _OUTCOMES.get(outcome, "stalled"), answer.iterations
    )
    return solved, multipliers[(d + 1) * m :]
