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

from critflow.arguments import checked
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.objectives import LengthVariance, Objective, TensionVariance, TransitionModulus, named_objective
from critflow.design.tolerances import UNSUPPORTED
from critflow.networks.network import Array, Network
from critflow.result import InputError, Record

# Columns of g P⁻¹ gᵀ that are held at once, in numbers.
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
    after, bypass = np.empty(m), np.empty(m)
    width = max(1, _BLOCK // (m * network.dimension))
    for first in range(0, m, width):
        edges = np.arange(first, min(first + width, m))
        response = np.asarray(g @ balance.factor.solve(np.asarray(g[edges].todense().T)))
        for column, edge in zip(response.T, edges, strict=True):
            bypass[edge] = 1 - sigma[edge] * column[edge]
            after[edge] = _without(goal, int(edge), sigma, L, column, bypass[edge])
    name = objective if isinstance(objective, str) else type(goal).__name__
    return EdgeLeverage(name, goal.evaluate(sigma, L)[0], after, bypass)


def cut(network: Network, edge: int) -> Network:
    """The network without one edge; vertices that then hang on nothing leave with it."""
    if not 0 <= edge < network.n_edges:
        raise InputError(f"there is no edge {edge}: edges are counted from 0 to {network.n_edges - 1}")
    kept = np.ones(network.n_edges, bool)
    kept[edge] = False
    return network.part(kept)[0]


def _without(goal: Objective, edge: int, sigma: Array, L: Array, column: Array, bypass: float) -> float:
    """The objective of the other edges after the cut of one, whose column of g P⁻¹ gᵀ is given."""
    if abs(bypass) <= UNSUPPORTED:
        return np.nan
    kept = np.ones(len(sigma), bool)
    kept[edge] = False
    there = (L + (sigma[edge] / bypass) * column[:, None] * L[edge])[kept]
    if not np.abs(there).max(initial=0.0) > UNSUPPORTED * np.abs(L).max():
        # The rest collapses to a point.
        return np.nan
    return _of_part(goal, kept).evaluate(sigma[kept], there)[0]


def _of_part(goal: Objective, kept: Array) -> Objective:
    """The objective for some of the edges."""
    if isinstance(goal, TransitionModulus):
        return TransitionModulus(goal.strain, goal.stiffness[kept], goal.volume)
    return goal
