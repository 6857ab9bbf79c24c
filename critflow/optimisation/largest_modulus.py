"""The largest modulus of a network over all stresses in closed form, with the configuration that attains it.

With L* the configuration at σ = k, virtual work gives Σσ L·(A + W)L = Σ T·(A + W)L* for every stress, T = σL and any
antisymmetric W, so by Cauchy–Schwarz (`GenericModulus`)
    μ_A ≤ min_W (1/V) Σ k|(A + W)L*|²,
for any signs of σ.  Equality requires the force network T = k(A + W)L*, whose stress tensor is symmetric for the best
W.  For a dilation that is σ = k.  For other strains T is not parallel to L*: in two dimensions the lengths in the
directions of T that close are the solution of one more linear system, and some are negative, which is compression.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from critflow.critical.edge_lengths import NO_LENGTH
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.quantity import evaluate_at
from critflow.critical.transition import TransitionModulus, force_map, is_dilation, transition_modulus, vanishes
from critflow.lengths.taut_edges import unknown_configuration
from critflow.linalg.tolerances import EPS
from critflow.linalg.vectors import dot
from critflow.networks.deformation import Deformable
from critflow.networks.network import Array, Network
from critflow.optimisation.optimum import Optimum
from critflow.result import InputError, Solution, Status

BALANCED = 1e-8  # relative force balance, and relative distance from the bound, of a modulus that attains its bound
# Determinant of the map F of forces, over |F|², below which all forces count as parallel: lengths grow as its inverse.
PARALLEL_FORCES = 1e-9

QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


def largest_modulus(network: Network | CriticalManifold, strain: Deformable) -> Optimum:
    """The configuration nearest to L* that attains `upper_bound`, stresses of both signs allowed.

    Nearest in Σk|L − L*|², unless the forces are nearly parallel: all others differ by isogonal modes.
    `Status.edge_collapse` or `Status.singular` and NaN where an edge of it has no length or all forces are parallel, as
    for uniaxial strains of isotropic networks, so that they close around no cell; the objective is then the bound, a
    limit: strains next to it attain theirs.  Where the bound is zero every configuration attains it, and that of σ = k
    is returned.
    Raises `InputError` in three dimensions except for dilations: such forces seldom close there.
    """
    manifold = CriticalManifold.of(network)
    network, modulus, shortest = manifold.network, transition_modulus(manifold.network, strain), 1.0
    A, k = modulus.symmetric, network.stiffness
    if not is_dilation(A) and network.dimension != 2:
        raise InputError("in three dimensions only the largest modulus of a dilation has a known configuration")
    balance = manifold.balance(k * np.sqrt(network.n_edges / (k @ k)))
    F, moment = force_map(network, balance.bond_vectors, A)
    bound, zero = float(np.trace(F @ moment @ F.T)) / network.volume, vanishes(F, moment, A)
    if zero or is_dilation(A):
        # F = A of a dilation is isotropic: the configuration is L* itself.
        solution: Solution[CriticalConfiguration] = manifold.solve(balance.sigma, balance=balance)
    else:
        solution, shortest = _closed(manifold, balance.bond_vectors, F, A, bound)
    here = solution.value
    stats = replace(solution.stats, method="closed_form", steps=0, residual=np.nan)
    value = modulus.evaluate(here)[0]
    optimum = Optimum(here, Status.ok, stats, objective=value, bound=_covering(bound, value, network.n_edges))
    if here.residual < BALANCED and (zero or abs(optimum.gap) < BALANCED) and shortest > NO_LENGTH:
        edges = here.collapsed_edges
        note = f"edges {', '.join(map(str, edges))} have no length there" if len(edges) else ""
        if not np.array_equal(here.sigma, balance.sigma):
            balance = manifold.balance(here.sigma)
        stats = replace(stats, residual=evaluate_at(balance, modulus).residual)
        return replace(optimum, stats=stats, collapsed_edges=edges, note=note)
    # Forces that are all parallel, or an edge that vanishes: the bound is approached, not attained.
    status = Status.edge_collapse if shortest <= NO_LENGTH else Status.singular if solution.ok else solution.status
    return replace(optimum, value=unknown_configuration(network), status=status, objective=bound)


def _covering(bound: float, value: float, n_edges: int) -> float:
    """The bound, or the value that attains it and exceeds it by the rounding of two sums over the edges."""
    return value if 0 < value - bound <= n_edges * EPS * bound else bound


def _closed(
    manifold: CriticalManifold, L_star: Array, F: Array, A: Array, bound: float
) -> tuple[Solution[CriticalConfiguration], float]:
    """The configuration with forces T = kFL*, and its shortest length over the mean."""
    k, parallel = manifold.network.stiffness, abs(float(np.linalg.det(F))) <= PARALLEL_FORCES * float(np.sum(F**2))
    B = F.T @ QUARTER_TURN.T
    for stretched in (False, True):
        if stretched:
            # Others with these forces: of L̃ = BL with B = FᵀJᵀ and n·L = L*·L̃ the constraints are not nearly dependent.
            L = np.linalg.solve(B, _across(manifold, L_star @ B.T, L_star).T).T
        else:
            L = _across(manifold, L_star, L_star @ F.T @ QUARTER_TURN.T)
        square = dot(L, L)
        solution = manifold.solve(k * dot(L_star @ F.T, L) / np.maximum(square, np.finfo(float).tiny))
        if parallel or abs(TransitionModulus(A).evaluate(solution.value)[0] / bound - 1) < BALANCED:
            break
    return solution, float(np.sqrt(square.min()) / np.sqrt(square).mean())


def _across(manifold: CriticalManifold, start: Array, normals: Array) -> Array:
    """L = start + g u (N_b, 2) without components along the normals n, n·L = 0, with the least Σk|g u|².

    Since gᵀ(k n) = 0, the constraints have the self-stress k, and this is a system of stresses and displacements.
    """
    network = manifold.network
    factor = manifold.saddle.factorize(network.stiffness, normals)
    u, _, _ = factor.solve(np.zeros((len(network.free), 2)), -dot(normals, start))
    return np.asarray(start + network.free_incidence @ u)
