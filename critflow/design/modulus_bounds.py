"""The largest modulus that any stress can give, in closed form, with the configuration that attains it.

With L* the configuration at σ = k, virtual work gives Σσ L·(A + W)L = Σ T·(A + W)L* for every stress, T = σL and any
antisymmetric W, so by Cauchy–Schwarz (`GenericModulus`)
    μ_A ≤ min_W (1/V) Σ k|(A + W)L*|²,
whatever the signs of σ.  Equality needs the force network T = k(A + W)L*, whose stress tensor the best W makes
symmetric.  For a dilation that is σ = k.  Other strains turn T away from L*: in two dimensions lengths along T that
close are one more linear system, and some of them come out negative, which is compression.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.optimize import linprog

from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.objectives import dilation, transition_modulus
from critflow.networks.network import Array, Network
from critflow.result import InputError, Solution, SolveError, Stats, Status
from critflow.rigidity.counts import spread_columns

# An edge of the attaining configuration shorter than this part of the mean has no stress to speak of.
_NO_LENGTH = 1e-10
# Relative force balance and distance from the bound of an answer that attains it.
_BALANCED = 1e-8

_QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


def modulus_bound(network: Network | CriticalManifold, strain: ArrayLike) -> float:
    """The largest modulus μ_A for the affine strain A (d, d) over all stresses of any sign; nothing exceeds it."""
    manifold = CriticalManifold.of(network)
    A = transition_modulus(manifold.network, strain).symmetric
    F, moment = _force_map(manifold.network, manifold.balance(manifold.network.stiffness).bond_vectors, A)
    return float(np.trace(F @ moment @ F.T)) / manifold.network.volume


def bulk_modulus_bound(network: Network | CriticalManifold) -> float:
    """The largest B_0 that any stress can give, (1/d²V) Σ k|L*|² with L* the configuration at σ = k."""
    manifold = CriticalManifold.of(network)
    return modulus_bound(manifold, dilation(manifold.network.dimension))


def largest_modulus(network: Network | CriticalManifold, strain: ArrayLike) -> Solution[CriticalConfiguration]:
    """The configuration nearest to L* that attains `modulus_bound`, stresses of both signs allowed.

    Nearest in Σk|L − L*|²: all others differ by isogonal modes.  `Status.edge_collapse` or `Status.singular` and NaN
    where an edge of it has no length or the forces are too nearly parallel to close; the bound, then a limit, stands
    in the statistics.  Raises `InputError` in three dimensions but for dilations: such forces seldom close there.
    """
    manifold = CriticalManifold.of(network)
    network = manifold.network
    A, k = transition_modulus(network, strain).symmetric, network.stiffness
    shortest = 1.0
    if np.allclose(A, A[0, 0] * np.eye(len(A)), rtol=0, atol=1e-14 * np.abs(A).max()):
        # F = A only stretches L*, which is the answer then.
        found = manifold.solve(k)
        F, moment = _force_map(network, found.value.bond_vectors if found.ok else manifold.balance(k).bond_vectors, A)
    elif network.dimension == 2:
        L_star = manifold.balance(k).bond_vectors
        F, moment = _force_map(network, L_star, A)
        sigma, shortest = _closed(manifold, L_star, F)
        found = manifold.solve(sigma)
    else:
        raise InputError("in three dimensions only the largest modulus of a dilation has a known configuration")
    bound = float(np.trace(F @ moment @ F.T)) / network.volume
    value = found.value
    reached = transition_modulus(network, A).evaluate(value.sigma, value.bond_vectors)[0]
    details = {"objective": reached, "bound": bound, "gap": 1 - reached / bound}
    status = Status.ok
    if not (value.residual < _BALANCED and abs(details["gap"]) < _BALANCED and shortest > _NO_LENGTH):
        # Forces that are all nearly parallel, or an edge that must vanish: the bound is approached, not attained.
        status = Status.edge_collapse if shortest <= _NO_LENGTH else Status.singular if found.ok else found.status
        nowhere = np.full_like(value.bond_vectors, np.nan)
        value = CriticalConfiguration(network, nowhere[:, 0], np.full_like(value.coordinates, np.nan), nowhere)
        details = {"objective": bound, "bound": bound, "gap": np.nan}
    error = value.error_bound
    return Solution(value, status, Stats("closed_form", 0, 1, value.residual, details, found.stats.condition, error))


def least_compressed_length(network: Network | CriticalManifold, strain: ArrayLike) -> float:
    """The least total length of compressed edges that a planar configuration with the largest modulus can have.

    All of them share the forces T = kFL* and differ by isogonal modes.  With t = T/|T| and n ⊥ t a linear program:
        least Σ p,  p ≥ 0,  p ≥ −t·(g x + b),  n·(g x + b) = 0.
    """
    manifold = CriticalManifold.of(network)
    network = manifold.network
    if network.dimension != 2:
        raise InputError("configurations of one force network are found in two dimensions only")
    L_star = manifold.balance(network.stiffness).bond_vectors
    F, _ = _force_map(network, L_star, transition_modulus(network, strain).symmetric)
    T = network.stiffness[:, None] * (L_star @ F.T)
    along = T / np.linalg.norm(T, axis=1)[:, None]
    across = along @ _QUARTER_TURN.T
    n_edges, n_coordinates, b = network.n_edges, 2 * len(network.free), network.boundary_vectors
    program = linprog(
        np.repeat([0.0, 1.0], [n_coordinates, n_edges]),
        A_ub=sp.hstack([-spread_columns(network, along), -sp.eye_array(n_edges)]),
        b_ub=np.einsum("ad,ad->a", along, b),
        A_eq=sp.hstack([spread_columns(network, across), sp.csr_array((n_edges, n_edges))]),
        b_eq=-np.einsum("ad,ad->a", across, b),
        bounds=[(None, None)] * n_coordinates + [(0, None)] * n_edges,
    )
    if program.status != 0:
        raise SolveError(f"no configuration has the largest modulus for this strain: {program.message}")
    return float(program.fun)


def _closed(manifold: CriticalManifold, L_star: Array, F: Array) -> tuple[Array, float]:
    """The stress of bond vectors L = L* + g u along the forces T = kFL*, and the shortest length over the mean.

    They have no component along n = JFL*, n·(L* + g u) = 0, and least Σk|g u|².  Since gᵀ(k n) = 0, the constraints
    have the self-stress k, and this is a system of stresses and displacements like any other.
    """
    network, k = manifold.network, manifold.network.stiffness
    along = L_star @ F.T
    across = along @ _QUARTER_TURN.T
    still = np.zeros((len(network.free), 2))
    u, _, _ = manifold.saddle.factorize(k, across).solve(still, -np.einsum("ad,ad->a", across, L_star))
    L = L_star + network.free_incidence @ u
    square = np.einsum("ad,ad->a", L, L)
    sigma = k * np.einsum("ad,ad->a", along, L) / np.maximum(square, np.finfo(float).tiny)
    shortest = float(np.sqrt(square.min()) / np.sqrt(square).mean())
    return sigma, shortest


def _force_map(network: Network, L_star: Array, A: Array) -> tuple[Array, Array]:
    """F = A + W of the best force network T = kFL*, and the moments M = Σ k L*L*ᵀ: F M is symmetric."""
    M = (network.stiffness[:, None] * L_star).T @ L_star
    W = scipy.linalg.solve_sylvester(M, M, M @ A - A @ M)
    return A + 0.5 * (W - W.T), M
