"""Relaxations of a problem on unit vectors: is there a z at which all quadratic forms zᵀQ_I z vanish?

Replace the products z_i z_j by a symmetric X ⪰ 0 of trace 1: the least |(⟨Q_I, X⟩)_I| over X is a bound from below of
the least |(zᵀQ_I z)_I|, and its dual is the largest t with Σ a_I Q_I ⪰ t·1 over |a| ≤ 1.  With products of four in
place of two the bound is tighter: positive if the forms have no common zero, in up to three variables.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement

import clarabel
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from critflow.cones import interior_point

SEMIDEFINITE = 1e-10  # gap and feasibility of semidefinite programs: reached by Clarabel on all networks tested

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Relaxation:
    """Solution of a relaxation."""

    bound: float  # lower bound of |(zᵀQ_I z)_I| (estimate: the dual value to the tolerance of the solver)
    multipliers: Array  # a
    moments: Array  # relaxed products X (second order only)
    solved: bool  # whether the program converged


def second_order_relaxation(forms: Array) -> Relaxation:
    """Least |(⟨Q_I, X⟩)_I| over X ⪰ 0, tr X = 1, for forms Q (N_s, n, n), with its multipliers a (N_s,), |a| ≤ 1."""
    n = forms.shape[1]
    # Moments are the entries X_ij, i <= j.
    rows, cols = _triangle(n)
    twice = np.where(rows == cols, 1.0, 2.0)
    number = np.zeros((n, n), int)
    number[rows, cols] = number[cols, rows] = np.arange(len(rows))
    return _least(forms[:, rows, cols] * twice, number, (rows == cols).astype(float))


def fourth_order_bound(forms: Array) -> float:
    """The bound by products of four, of |(z_i z_j zᵀQ_I z)| over all I and i <= j.

    A positive value proves that no unit z makes all forms zero; in up to three variables the converse is true
    too, because forms of degree four that are nowhere negative are then sums of squares.  NaN if not solved.
    """
    n_forms, n = forms.shape[:2]
    quartic: dict[tuple[int, ...], int] = {
        key: place for place, key in enumerate(combinations_with_replacement(range(n), 4))
    }
    rows, cols = _triangle(n)
    pairs = list(zip(rows.tolist(), cols.tolist(), strict=True))

    def moment(*indices: int) -> int:
        return quartic[tuple(sorted(indices))]

    number = np.array([[moment(*p, *q) for q in pairs] for p in pairs])
    products = np.zeros((n_forms, len(pairs), len(quartic)))
    for place, pair in enumerate(pairs):
        for i, j in np.ndindex(n, n):
            products[:, place, moment(*pair, i, j)] += forms[:, i, j]
    one = np.zeros(len(quartic))
    for i, j in np.ndindex(n, n):
        one[moment(i, i, j, j)] += 1.0
    answer = _least(products.reshape(-1, len(quartic)), number, one)
    return answer.bound if answer.solved else np.nan


def _least(measured: Array, number: NDArray[np.int64], one: Array) -> Relaxation:
    """Minimise |B y| over moments y with M(y)_ij = y[number_ij] ⪰ 0 and one·y = 1; B is `measured` (n_rows, n_y)."""
    n_moments, n_given = measured.shape[1], len(measured)
    # More rows than moments are reduced to the number of moments, with the same |B y|.
    back, kept = np.linalg.qr(measured) if n_given > n_moments else (np.eye(n_given), measured)
    rows, cols = _triangle(len(number))
    weight = np.where(rows == cols, 1.0, np.sqrt(2.0))
    # Unknowns (y, s); Clarabel requires b − A z in the cones: one·y = 1, |B y| <= s, M(y) ⪰ 0.
    semidefinite = sp.csc_matrix(
        (-weight, (np.arange(len(rows)), number[rows, cols])), shape=(len(rows), n_moments + 1)
    )
    A = sp.vstack(
        [
            sp.csc_matrix(np.append(one, 0.0)[None]),
            sp.csc_matrix(np.append(np.zeros(n_moments), -1.0)[None]),
            sp.csc_matrix(np.hstack([-kept, np.zeros((len(kept), 1))])),
            semidefinite,
        ],
        format="csc",
    )
    b = np.zeros(A.shape[0])
    b[0] = 1.0
    cost = np.append(np.zeros(n_moments), 1.0)
    cones = [
        clarabel.ZeroConeT(1),
        clarabel.SecondOrderConeT(1 + len(kept)),
        clarabel.PSDTriangleConeT(len(number)),
    ]
    answer = interior_point(cost, A, b, cones, SEMIDEFINITE)
    y = np.array(answer.x)[:-1]
    multipliers = -back @ np.array(answer.z)[2 : 2 + len(kept)]
    solved = answer.status in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)
    return Relaxation(float(answer.obj_val_dual), multipliers, y[number], solved)


def _triangle(n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the upper triangle, column after column."""
    cols, rows = np.tril_indices(n)
    return rows, cols
