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
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import checked, shown
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.quantity import Quantity, dot
from critflow.linalg.vectors import norms
from critflow.networks.network import Array, IntArray, Network
from critflow.quantities.vocabulary import quantity
from critflow.result import InputError, Record

# Part of a stress that flows around an edge below which its cut opens the network; rounding leaves 1e-13.
UNSUPPORTED = 1e-10

Mask = NDArray[np.bool_]

# Columns of g P⁻¹ gᵀ in memory at once, in numbers.
_BLOCK = 4_000_000


@dataclass(frozen=True, eq=False)
class EdgeLeverage(Record):
    """A quantity after cutting each edge with the stress of the others unchanged; NaN where the cut opens the network.

    quantity  name
    before    value of the quantity
    after     (N_b,) values after the cut of each edge
    bypass    (N_b,) 1 − σ_α r_α: part of the stress that flows around each edge, between 0 and 1 for σ > 0
    """

    quantity: str
    before: float
    after: Array
    bypass: Array

    @property
    def change(self) -> Array:
        """after − before, (N_b,)."""
        return self.after - self.before


@checked
def edge_leverage(critical: CriticalConfiguration, name: str | Quantity = "B_0") -> EdgeLeverage:
    """The exact change of a quantity by cutting each edge, all at once, without a new factorisation.

    name  of a quantity, or a `Quantity`

    The cost is that of N_b solves with one factor and N_b evaluations.  Raises `InputError` for unknown names, and for
    stresses that are zero somewhere.

    >>> import critflow as cf
    >>> found = cf.edge_leverage(cf.optimize(cf.honeycomb_network(2, 2), 'B_0'))
    >>> round(found.before, 6), round(float(found.change[0]), 6)
    (0.288675, -0.057735)
    """
    network, sigma = critical.network, critical.sigma
    goal = quantity(network, name)
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
        after[edges] = values_after(goal, network, sigma, L, response, edges, kept)
    return EdgeLeverage(goal.name, goal.evaluate(balance)[0], after, bypass)


@checked
def cut(network: Network, edge: int) -> Network:
    """The network without one edge; vertices that then hang on nothing leave with it."""
    if not 0 <= edge < network.n_edges:
        raise InputError(f"there is no edge {edge}: edges are counted from 0 to {network.n_edges - 1}")
    kept = np.ones(network.n_edges, bool)
    kept[edge] = False
    return network.part(kept)[0]


@checked
def add(network: Network, tail: int, head: int, offset: ArrayLike | None = None, stiffness: float = 1.0) -> Network:
    """The network with one edge more, its last one, from a vertex to the image of another in a cell at `offset` (d,).

    The faces of the network, if it has any, are not kept: the edge may cross others.
    """
    n, d = network.n_vertices, network.dimension
    if not (0 <= tail < n and 0 <= head < n):
        raise InputError(f"an edge joins two vertices, counted from 0 to {n - 1}, not {tail} and {head}")
    image = np.zeros(d) if offset is None else np.asarray(offset, dtype=float)
    if image.shape != (d,) or not (image == np.round(image)).all():
        raise InputError(f"the offset must be {d} whole numbers of cells, not {shown(offset)}")
    return Network(
        np.concatenate([network.edges, [[tail, head]]]),
        np.concatenate([network.offsets, [image.astype(int)]]),
        network.cell,
        np.append(network.stiffness, stiffness),
        network.pins,
        positions=network.positions,
    )


class Part:
    """Some of the edges of a network with their stress and bond vectors, of which quantities are evaluated.

    edges  (N_b,) mask
    """

    def __init__(self, network: Network, edges: Mask, sigma: Array, L: Array):
        self._whole, self._edges = network, edges
        self.sigma, self.bond_vectors = sigma[edges], L[edges]
        self.stiffness, self.dimension = network.stiffness[edges], network.dimension
        self.n_edges = len(self.sigma)

    @property
    def volume(self) -> float:
        return self._whole.volume

    @cached_property
    def manifold(self) -> CriticalManifold:
        """That of the part as a network of its own."""
        return CriticalManifold(self._whole.part(self._edges)[0])

    @property
    def network(self) -> Any:
        """The attributes of the network that formulas use, without the checks of a new one."""
        return self


def values_after(
    goal: Quantity, network: Network, sigma: Array, L: Array, columns: Array, edges: IntArray, kept: Mask
) -> Array:
    """A quantity of the kept edges (N_b,) without each of n edges, NaN where the cut opens the network, (n,).

    columns  (N_b, n) of g P⁻¹ gᵀ
    """
    own = np.arange(len(edges))
    bypass = 1 - sigma[edges] * columns[edges, own]
    opened = np.abs(bypass) <= UNSUPPORTED
    bypass = np.where(opened, 1.0, bypass)
    of_stress = goal.of_stress(network.dimension)
    if of_stress is not None:
        work, cost = _work_and_cost_after(of_stress.strain, network, sigma, L, columns, edges, bypass, kept)
        value = work**2 / (network.volume * cost) if of_stress.squared else work / np.sqrt(cost)
        return np.where(opened, np.nan, value)
    value, growth, rest = np.full(len(edges), np.nan), sigma[edges] / bypass, kept.copy()
    for n in np.flatnonzero(~opened):
        rest[edges[n]] = False
        there = L + growth[n] * columns[:, n, None] * L[edges[n]]
        length = norms(there)
        # Without stress nothing has a length: the rest collapses to a point.
        if length[rest].max(initial=0.0) > UNSUPPORTED * length.max():
            value[n] = goal.evaluate(Part(network, rest, sigma, there))[0]
        rest[edges[n]] = kept[edges[n]]
    return value


def _work_and_cost_after(
    A: Array, network: Network, sigma: Array, L: Array, columns: Array, edges: IntArray, bypass: Array, kept: Mask
) -> tuple[Array, Array]:
    """W = Σσ L·A L and D = Σσ²|L|²/k without each edge, (n,) each; NaN costs where the network collapses.

    With C = g P⁻¹ gᵀ, CσC = C and C(σ ∘ L) = 0, W loses σ L·A L/(1 − σr).  The parameters of `values_after`, with
    1 − σr of each edge; many parameters: each is a part of the rank-one update.
    """
    removed, weight = L[edges], np.where(kept, sigma**2 / network.stiffness, 0.0)
    growth = sigma[edges] / bypass
    work = float(np.einsum("a,ad,ad->", np.where(kept, sigma, 0.0), L, L @ A))
    change = work - sigma[edges] * dot(removed, removed @ A) / bypass
    square, linear = dot(removed, removed), dot(columns.T @ (weight[:, None] * L), removed)
    cost = float(weight @ dot(L, L)) + 2 * growth * linear
    cost += growth**2 * square * np.einsum("a,ab,ab->b", weight, columns, columns)
    cost -= weight[edges] * square / bypass**2
    return change, np.where(cost <= UNSUPPORTED**2 * float(weight @ dot(L, L)), np.nan, cost)
