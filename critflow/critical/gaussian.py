"""The Gaussian curvature of the critical manifold: the product of all principal curvatures, by determinants.

K = 1/det(−|σ|B on σ^⊥).  σ spans the null space of B = −R P⁻¹ Rᵀ, R = R^h, where there is no other self-stress; then
the minor of B without one edge e is det(B on σ^⊥) (σ_e/|σ|)², and it is the Schur complement of P in a saddle matrix,

    M = [[P ⊗ 1, Rᵀ], [R, 0]] without the row and column of e,    det(B without e) = det M/det(P)^d.

Inertia counts the signs: B without e has the signature of B on σ^⊥.  With several self-stresses B has further null
directions, in which the curvature is infinite.

Small networks by one dense factorisation of M.  Of large ones edges of softness δ add RᵀR/δ to the prestress, and
det(P ⊗ 1 + RᵀR/δ)/det(P ⊗ 1) = Π(r_i + δ)/δ^(N_b − 1) with the radii r_i, extrapolated to δ = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from critflow.arguments import checked
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.linalg.factor import Factor
from critflow.linalg.matrices import edge_blocks
from critflow.linalg.tolerances import EPS
from critflow.networks.network import Array
from critflow.result import Record, Solution, Stats, Status

# Softnesses of the edges, relative to that of the prestress, at which determinants are extrapolated to zero softness,
# in turn until one is below all radii: the extrapolation error is of third order, rounding goes as EPS/SOFTNESS.
SOFTNESS = (1e-6, 1e-8, 1e-10)
UNCERTAIN_LOGARITHM = 0.1  # error of log|K| from which K, and the signs of curvatures, are not certain
DENSE_SADDLE = 1000  # rows of a saddle matrix whose determinant is found by a dense factorisation: below a second


@dataclass(frozen=True)
class GaussianCurvature(Record):
    """The product K of all N_b − 1 principal curvatures: log|K|, and how many of them are negative."""

    log_size: float
    n_negative: int


@checked
def gaussian_curvature(
    manifold: CriticalManifold, sigma: ArrayLike, *, throw: bool = True
) -> Solution[GaussianCurvature]:
    """K = 1/det(−|σ|B on σ^⊥) at a stress (N_b,), by one dense factorisation or three and more sparse ones.

    Error bound (estimate): `stats.residual` limits the error of log|K|.  In small networks it sums the effects of all
    errors of σ, of the bond vectors and of the elimination to first order, by the inverse of M; in large ones it is
    the last step of the extrapolation plus the rounding of determinants.

    `Status.singular` where P(σ) is singular, and where more than one self-stress is certain by counting, so that K is
    infinite; `Status.edge_collapse` where an edge has no length; `Status.ill_conditioned` and NaN where a curvature is
    infinite or below rounding.
    """
    solution = _solve(manifold, sigma)
    return solution.or_raise("no curvature for this stress") if throw else solution


def _solve(manifold: CriticalManifold, sigma: ArrayLike) -> Solution[GaussianCurvature]:
    network = manifold.network
    n_coordinates, n = network.dimension * len(network.free), network.n_edges
    nothing, stats = GaussianCurvature(np.nan, 0), Stats("determinants")
    found = manifold.solve(sigma)
    if not found.ok:
        return Solution(nothing, found.status, stats, found.note)
    critical = found.value
    loops = network.edges[:, 0] == network.edges[:, 1]
    if n - n_coordinates > 1 or (loops.any() and n > 1):
        infinite = GaussianCurvature(np.inf, 0)
        note = "the configuration has several self-stresses, so that some curvatures are infinite: remove edges"
        return Solution(infinite, Status.singular, stats, note)
    if len(critical.collapsed_edges):
        note = "an edge without length leaves the manifold no tangent plane here: move the stress away"
        return Solution(nothing, Status.edge_collapse, stats, note)
    method = _dense if n_coordinates + n <= DENSE_SADDLE else _extrapolated
    value, error = method(manifold, critical, found.stats.condition)
    if error < UNCERTAIN_LOGARITHM:
        return Solution(value, Status.ok, Stats("determinants", 1, residual=error))
    note = "a curvature is infinite, as with several self-stresses, or below rounding: request principal curvatures"
    return Solution(nothing, Status.ill_conditioned, Stats("determinants", 1, residual=error), note)


@dataclass(frozen=True, eq=False)
class _Determinant:
    """log|det A|, its error bound and the number of negative eigenvalues."""

    log_size: float
    error: float
    n_negative: int


def _dense(manifold: CriticalManifold, critical: CriticalConfiguration, _: float) -> tuple[GaussianCurvature, float]:
    """K by M itself, without the edge of the largest stress."""
    network, stress, L = manifold.network, critical.sigma, critical.bond_vectors
    d, n = network.dimension, network.n_edges
    kept = np.delete(np.arange(n), int(np.abs(stress).argmax()))
    g = network.free_incidence.toarray()
    P, size = g.T @ (stress[:, None] * g), np.abs(g).T @ (np.abs(stress)[:, None] * np.abs(g))
    n_free = g.shape[1]
    rows = [g[kept] * L[kept, axis, None] for axis in range(d)]
    errors = [np.abs(g[kept]) * critical.bond_errors[kept, None]] * d
    M = _saddle([P] * d, np.hstack(rows), n_free)
    prestress = _determinant(P, EPS * size * (2 + n_free**0.5))
    saddle = _determinant(M, _saddle([EPS * size * (2 + n_free**0.5)] * d, np.hstack(errors), n_free))
    norm = float(np.linalg.norm(stress))
    log_B = saddle.log_size - d * prestress.log_size - 2 * np.log(np.abs(stress).max() / norm)
    error = saddle.error + d * prestress.error + 4 * EPS * (n + abs(saddle.log_size) + d * abs(prestress.log_size))
    n_negative = n - 1 - (saddle.n_negative - d * prestress.n_negative)
    return GaussianCurvature(float(-log_B - (n - 1) * np.log(norm)), n_negative), error


def _saddle(blocks: list[Array], R: Array, n_free: int) -> Array:
    """[[P ⊗ 1, Rᵀ], [R, 0]] with coordinates ordered by axes."""
    zero = np.zeros((len(R), len(R)))
    return np.block([[scipy.linalg.block_diag(*blocks), R.T], [R, zero]])


def _determinant(A: Array, errors: Array) -> _Determinant:
    """The determinant of a symmetric matrix (n, n) whose entries have these errors; infinite error if singular.

    Error bound (estimate): Σ|A⁻¹||δA| to first order, with the backward error n EPS |L||D||Lᵀ| of the elimination.
    """
    scale, n = np.ones(len(A)), len(A)
    scaled = A
    for _ in range(3):
        # Powers of two, which round nothing.
        largest = np.abs(scaled).max(axis=1)
        if not largest.all():
            return _Determinant(-np.inf, np.inf, 0)
        scale = scale * np.exp2(-np.round(np.log2(largest) / 2))
        scaled = scale[:, None] * A * scale
    lower, D, _ = scipy.linalg.ldl(scaled)
    values = np.linalg.eigvalsh(D)
    if not np.abs(values).min() > 0:
        return _Determinant(-np.inf, np.inf, 0)
    try:
        inverse = np.abs(np.linalg.inv(scaled))
    except np.linalg.LinAlgError:
        return _Determinant(-np.inf, np.inf, 0)
    backward = scale[:, None] * errors * scale + n * EPS * (np.abs(lower) @ np.abs(D) @ np.abs(lower).T)
    log_size = float(np.log(np.abs(values)).sum() - 2 * np.log(scale).sum())
    error = float(np.sum(inverse * backward))
    return _Determinant(log_size, error if np.isfinite(error) else np.inf, int(np.count_nonzero(values < 0)))


def _extrapolated(
    manifold: CriticalManifold, critical: CriticalConfiguration, condition: float
) -> tuple[GaussianCurvature, float]:
    """K by extrapolation to edges of no softness."""
    found = GaussianCurvature(np.nan, 0), np.inf
    for softness in SOFTNESS:
        found = _extrapolate(manifold, critical, condition, softness)
        if found[1] < UNCERTAIN_LOGARITHM:
            break
    return found


def _extrapolate(
    manifold: CriticalManifold, critical: CriticalConfiguration, condition: float, relative: float
) -> tuple[GaussianCurvature, float]:
    """K from edges of a softness relative to that of the prestress; infinite error where a radius is not larger."""
    network, stress, L = manifold.network, critical.sigma, critical.bond_vectors
    n = network.n_edges
    prestress, pattern = manifold.prestress.factorize(stress), manifold.hessian
    softness = relative * float(np.mean(L**2) / np.mean(np.abs(stress)))
    logs, negative = [], []
    for soft in softness * np.array([1.0, 2.0, 4.0]):
        stiffened = pattern.factorize(edge_blocks(np.full(n, 1 / soft), L, stress))
        logs.append(_log_size(stiffened) - network.dimension * _log_size(prestress) + (n - 1) * np.log(soft))
        negative.append(network.dimension * prestress.n_negative - stiffened.n_negative)
    # Values at δ, 2δ and 4δ cancel the first two orders; the difference of the orders estimates the remainder.
    linear, quadratic = 2 * logs[0] - logs[1], (8 * logs[0] - 6 * logs[1] + logs[2]) / 3
    # Elimination without a choice of pivots grows by the condition of P where signs are mixed.
    rounding = EPS / relative * (40 * np.sqrt(n) + n * condition * bool((stress < 0).any()))
    error = abs(quadratic - linear) + rounding
    # A radius below the softness adds log 2 to each difference, and the series does not converge.
    if max(abs(logs[1] - logs[0]), abs(logs[2] - logs[1])) > UNCERTAIN_LOGARITHM or len(set(negative)) > 1:
        error = np.inf
    value = GaussianCurvature(float(-quadratic - (n - 1) * np.log(np.linalg.norm(stress))), negative[0])
    return value, float(error)


def _log_size(factor: Factor) -> float:
    """log|det| of a factorised matrix."""
    return float(np.log(np.abs(factor.pivots)).sum())
