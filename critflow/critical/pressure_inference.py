"""Tensions and pressures that balance at observed positions: what the picture of a tissue determines.

Balance A(x)(σ, p) = 0 is linear in stresses and pressures.  Where three edges meet at each vertex these have, but for
their scale and a common pressure, as many components as the coordinates: every picture balances under exactly one
(σ, p), and no residual is left to test it by.  An error δx of the positions changes them by −A⁻¹ M δx, with the matrix
M = P + iQ of balance as real 2 × 2 blocks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from critflow.critical.pressures import PressureManifold, PressurisedConfiguration, pressure_jumps
from critflow.linalg.matrices import spread_columns
from critflow.linalg.tolerances import LARGEST_DENSE
from critflow.networks.network import Array, Network
from critflow.result import InputError, Solution, Stats, Status

# Relative distance from the observed positions beyond which the balance of the tensions and pressures found from them
# has lost its digits.
REPRODUCED = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class NearestPressures(Solution[PressurisedConfiguration]):
    """The tensions and pressures that balance at observed positions.

    stress_error    (N_b,) standard error of σ for independent errors s of all coordinates; NaN for large networks
    pressure_error  (N_f,) that of p likewise
    amplification   root mean square relative error of tensions, over that of coordinates, s/⟨|L|⟩
    error           s as given; positions alone do not show it
    distance        root mean square distance of the configuration from the observed positions: rounding
    """

    stress_error: Array = field(repr=False)
    pressure_error: Array = field(repr=False)
    amplification: float
    error: float
    distance: float


def infer_pressures(network: Network, x: Array, error: float | None) -> NearestPressures:
    """σ and p in balance at coordinates x (N_v, 2), with their standard errors for an error s of the coordinates.

    Raises `InputError` for networks without faces, and where (σ, p) has not as many components as the coordinates.
    """
    L, m = network.bond_vectors(x), network.n_edges
    jumps = pressure_jumps(network)
    n_faces = jumps.shape[1]
    forces = _forces(network, L, jumps)
    gauges = _gauges(network, n_faces)
    if forces.shape[0] + gauges.shape[0] != forces.shape[1]:
        raise InputError(
            f"{m} tensions and {n_faces} pressures are not determined by {forces.shape[0]} coordinates: this needs "
            "three edges at each free vertex; leave out pressures=True, or pressures of zero, for other networks"
        )
    factor = splu(sp.csc_array(sp.vstack([forces, gauges])))
    right = np.zeros(forces.shape[1])
    right[forces.shape[0]] = 1.0
    u = factor.solve(right)
    manifold = PressureManifold(network)
    found = manifold.solve(u[:m], u[m:])
    scale = float(found.value.sigma @ u[:m] / (u[:m] @ u[:m]))
    displacement = found.value.coordinates - x
    if not network.pins:
        displacement = displacement - displacement.mean(axis=0)
    distance = float(np.sqrt(np.mean(np.sum(displacement**2, axis=1))))
    length = np.linalg.norm(L, axis=1)
    spread = np.full(len(u), np.nan)
    if (2 * network.n_vertices) ** 2 <= LARGEST_DENSE:
        spread = _spread(network, factor.solve, u, jumps, gauges.shape[0])
    relative = spread[:m] / np.abs(u[:m])
    s = np.nan if error is None else float(error)
    certain = found.ok and distance < REPRODUCED * float(length.mean())
    n_pushed = int(np.sum(found.value.sigma < 0))
    solution = NearestPressures(
        value=found.value,
        status=Status.ok if certain else Status.ill_conditioned,
        note=f"{n_pushed} of {m} edges carry compression" if n_pushed and certain else "",
        stats=Stats("linear", 1, residual=found.value.residual, condition=found.stats.condition),
        stress_error=s * scale * spread[:m],
        pressure_error=s * scale * spread[m:],
        amplification=float(np.sqrt(np.mean(relative**2)) * length.mean()),
        error=s,
        distance=distance,
    )
    return solution


def _forces(network: Network, L: Array, jumps: sp.csr_array) -> sp.csr_array:
    """A (2 n_free, N_b + N_f): unbalanced forces, by vertex and axis, of (σ, p)."""
    order = np.arange(2 * len(network.free)).reshape(2, -1).T.ravel()
    spread = abs(network.divergence)
    pushed = sp.vstack([spread @ sp.diags_array(half) @ jumps for half in (-0.5 * L[:, 1], 0.5 * L[:, 0])])
    return sp.csr_array(sp.hstack([spread_columns(network, L).T, sp.csr_array(pushed)[order]]))


def _gauges(network: Network, n_faces: int) -> sp.csr_array:
    """Rows that fix Σσ and, of a periodic network, Σp."""
    scale = np.concatenate([np.ones(network.n_edges), np.zeros(n_faces)])
    return sp.csr_array(np.array([scale] if network.pins else [scale, 1 - scale]))


def _spread(network: Network, solve: Callable[[Array], Array], u: Array, jumps: sp.csr_array, n_gauges: int) -> Array:
    """Standard errors of u = (σ, p) for unit errors of all coordinates that were observed."""
    m = network.n_edges
    moved = network.free_incidence if network.pins else network.incidence
    pulled = network.divergence @ sp.diags_array(u[:m]) @ moved
    pushed = 0.5 * abs(network.divergence) @ sp.diags_array(jumps @ u[m:]) @ moved
    # Rows by vertex and axis as in the matrix of forces; columns are x and y of all vertices.
    blocks = np.empty((pulled.shape[0], 2, 2 * pulled.shape[1]))
    blocks[:, 0] = np.hstack([pulled.toarray(), -pushed.toarray()])
    blocks[:, 1] = np.hstack([pushed.toarray(), pulled.toarray()])
    right = np.concatenate([blocks.reshape(-1, blocks.shape[2]), np.zeros((n_gauges, blocks.shape[2]))])
    return np.asarray(np.linalg.norm(solve(right), axis=1))
