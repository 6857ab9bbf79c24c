"""The exact effect of cutting each edge of a critical configuration, for all edges at once.

Cut edge α and keep the stress of the others.  P loses σ_α g_α g_αᵀ, so by the formula of Sherman and Morrison, with
r_α = g_αᵀ P⁻¹ g_α,
    ΔL_β = σ_α (g P⁻¹ g_αᵀ)_β L_α/(1 − σ_α r_α).
1 − σ_α r_α is the part of the stress that flows around the edge: 0 for a bridge, whose cut opens the network.  At
σ = k, the stiffest configuration, the cut network is again its stiffest one, and the change of B_0 has a closed form,
    ΔB_0 = −k_α|L_α|²/(d² V (1 − k_α r_α)).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from critflow.arguments import checked
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.objectives import LengthVariance, Objective, TensionVariance, TransitionModulus, named_objective
from critflow.design.tolerances import UNSUPPORTED
from critflow.networks.network import Array, IntArray
from critflow.result import InputError, Record

Mask = NDArray[np.bool_]

# Columns of g P⁻¹ gᵀ in memory at once, in numbers.
_BLOCK = 4_000_000


@dataclass(frozen=True, eq=False)
class EdgeLeverage(Record):
    """Objective after cutting each edge with the stress of the others unchanged; NaN where the cut opens the network.

    objective  name
    before     value of the objective
    after      (N_b,) values after the cut of each edge
    bypass     (N_b,) 1 − σ_α r_α: part of the stress that flows around each edge, between 0 and 1 for σ > 0
    """

    objective: str
    before: float
    after: Array
    bypass: Array

    @property
    def change(self) -> Array:
        """after − before, (N_b,)."""
        return self.after - self.before


@checked
def edge_leverage(
    critical: CriticalConfiguration, objective: str | Objective = "bulk_modulus", threshold: float | None = None
) -> EdgeLeverage:
    """The exact change of an objective by cutting each edge, all at once, without a new factorisation.

    objective  "bulk_modulus", "shear_modulus", "length_variance", "tension_variance", or an `Objective` of these kinds
    threshold  r of the penalty of the shear modulus; None without it

    The cost is that of N_b solves with one factor and N_b evaluations.  Raises `InputError` for other objectives, whose
    values at fewer edges are not defined, and for stresses that are zero somewhere.

    >>> import critflow as cf
    >>> found = cf.edge_leverage(cf.optimize(cf.lattice("honeycomb", 2, 2), 'bulk_modulus'))
    >>> round(found.before, 6), round(float(found.change[0]), 6)
    (0.288675, -0.057735)
    """
    network, sigma = critical.network, critical.sigma
    goal = named_objective(network, objective, threshold) if isinstance(objective, str) else objective
    if not isinstance(goal, LengthVariance | TensionVariance | TransitionModulus):
        raise InputError(
            f"{type(goal).__name__} has no value for a network with an edge less: choose another objective"
        )
    if not (sigma != 0).all():
        raise InputError(
            "edges without stress change nothing when they are cut: use the configuration of the taut part"
        )
    balance = CriticalManifold(network).balance(sigma)
    g, L = network.free_incidence, balance.bond_vectors
    m = network.n_edges
    kept, after, bypass = np.ones(m, bool), np.empty(m), np.empty(m)
    width = max(1, _BLOCK // (m * network.dimension))
    for first in range(0, m, width):
        edges = np.arange(first, min(first + width, m))
        response = np.asarray(g @ balance.factor.solve(np.asarray(g[edges].todense().T)))
        bypass[edges] = 1 - sigma[edges] * response[edges, np.arange(len(edges))]
        after[edges] = values_after(goal, sigma, L, response, edges, kept)
    name = objective if isinstance(objective, str) else type(goal).__name__
    return EdgeLeverage(name, goal.evaluate(sigma, L)[0], after, bypass)


def values_after(goal: Objective, sigma: Array, L: Array, columns: Array, edges: IntArray, kept: Mask) -> Array:
    """The objective of the kept edges (N_b,) without each of n edges, NaN where the cut opens the network, (n,).

    columns  (N_b, n) of g P⁻¹ gᵀ
    """
    own = np.arange(len(edges))
    bypass = 1 - sigma[edges] * columns[edges, own]
    opened = np.abs(bypass) <= UNSUPPORTED
    bypass = np.where(opened, 1.0, bypass)
    growth = sigma[edges] / bypass
    if isinstance(goal, TransitionModulus):
        value = _modulus_after(goal, sigma, L, columns, edges, bypass, kept)
    else:
        there = L[:, None, :] + (growth * columns)[:, :, None] * L[edges]
        measured = np.linalg.norm(there, axis=2) * (sigma[:, None] if isinstance(goal, TensionVariance) else 1.0)
        rest = np.repeat(kept[:, None], len(edges), axis=1)
        rest[edges, own] = False
        # Without stress nothing has a length: the rest collapses to a point.
        size = np.abs(measured).max(axis=0, initial=0.0, where=rest)
        opened |= size <= UNSUPPORTED * np.abs(measured).max(axis=0)
        mean = np.mean(measured, axis=0, where=rest)
        value = np.mean((measured - mean) ** 2, axis=0, where=rest) / np.where(opened, 1.0, mean) ** 2
    return np.where(opened, np.nan, value)


def _modulus_after(
    goal: TransitionModulus, sigma: Array, L: Array, columns: Array, edges: IntArray, bypass: Array, kept: Mask
) -> Array:
    """μ = W²/(V D) without each edge: with C = g P⁻¹ gᵀ, CσC = C and C(σ ∘ L) = 0, W = Σσ L·A L loses σ L·A L/(1 − σr).

    The parameters of `values_after`, with 1 − σr of each edge.
    """
    removed, weight = L[edges], np.where(kept, sigma**2 / goal.stiffness, 0.0)
    growth = sigma[edges] / bypass
    work = float(np.einsum("a,ad,ad->", np.where(kept, sigma, 0.0), L, L @ goal.symmetric))
    work = work - sigma[edges] * np.einsum("ad,ad->a", removed, removed @ goal.symmetric) / bypass
    square = np.einsum("ad,ad->a", removed, removed)
    linear = np.einsum("ad,ad->a", columns.T @ (weight[:, None] * L), removed)
    cost = float(weight @ np.einsum("ad,ad->a", L, L)) + 2 * growth * linear
    cost = (
        cost
        + growth**2 * square * np.einsum("a,ab,ab->b", weight, columns, columns)
        - weight[edges] * square / bypass**2
    )
    collapsed = cost <= UNSUPPORTED**2 * float(weight @ np.einsum("ad,ad->a", L, L))
    return np.where(collapsed, np.nan, work**2 / (goal.volume * np.where(collapsed, 1.0, cost)))
