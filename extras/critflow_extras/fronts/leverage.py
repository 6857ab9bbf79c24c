"""The exact effect of cutting each edge of a critical configuration, for all edges at once.

Cut edge α and keep the stress of the others.  P loses σ_α g_α g_αᵀ, so by the formula of Sherman and Morrison, with the
column c = g P⁻¹ g_αᵀ and r = c_α,
    ΔL_β = σ_α c_β L_α/(1 − σ_α r),   1 − σ_α r = Σ_{β≠α} σ_β c_β²/r.
1 − σ_α r is the part of the stress that flows around the edge: 0 for a bridge, whose cut opens the network.  The sum
has no cancellation for σ > 0.  Columns are refined on the forces that their stresses leave, edge by edge, which have an
error relative to each stress, however much stresses differ.

At σ = k, the stiffest configuration, the cut network is again its stiffest one, and ΔB_0 has a closed form,
    ΔB_0 = −k_α|L_α|²/(d² V (1 − k_α r_α)).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.linear_response import TRUSTED_ERROR
from critflow.manifold import NO_LENGTH, CriticalConfiguration, CriticalManifold
from critflow.networks import Array, IntArray, Network
from critflow.numerics import EPS, dot, norms
from critflow.quantities import Quantity, quantity, require_valid
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.sparse import Factor
from critflow_extras.targets.stress_form import stress_form

# Rounding of columns that were updated, and of refined ones, relative to r: 1 − σ_α r below its square times Σ|σ|/|σ_α|
# is that of a bridge, and Σσ²|L|²/k below it times the terms of the sum that of a network that collapses.
UPDATED, EXACT = 1e-9, 1e-14
# Corrections of a column below this part of it have converged; most corrections, and the least decrease of each.
_REFINED, _MOST_CORRECTIONS, _DECREASE = 1e-13, 10, 0.5
# Ratio of stresses beyond which corrections of columns may not converge: P then keeps no digit of the smallest.
LARGEST_RATIO = 1e12
_MARGIN = 30.0  # errors of values in units of the changes that two sets of roundings cause

Mask = NDArray[np.bool_]

# Columns of g P⁻¹ gᵀ at once, in numbers: the arrays of a block fit the cache of the processor.
_BLOCK = 150_000


@dataclass(frozen=True, eq=False, repr=False)
class EdgeLeverage(Record):
    """A quantity after cutting each edge with the stress of the others unchanged; NaN where the cut opens the network.

    Numbers in the name are those of edges and faces of the network given; cutting an edge that it names, or one of the
    sides of a face, leaves NaN.

    quantity  name
    before    value of the quantity
    after     (N_b,) values after the cut of each edge
    errors    of them (estimate), (N_b,)
    bypass    (N_b,) 1 − σ_α r_α: part of the stress that flows around each edge, between 0 and 1 for σ > 0
    bypass_errors  of it (estimate), (N_b,)
    """

    quantity: str
    before: float
    after: Array
    errors: Array
    bypass: Array
    bypass_errors: Array

    @property
    def change(self) -> Array:
        """after − before, (N_b,)."""
        return self.after - self.before


@running("edge_leverage")
def edge_leverage(critical: CriticalConfiguration, name: str | Quantity = "B_0") -> Solution[EdgeLeverage]:
    """The exact change of a quantity by cutting each edge, all at once, without a new factorisation.

    name  of a quantity, or a `Quantity`

    The cost is that of a few N_b solves with one factor and 2 N_b evaluations.  `Status.ill_conditioned`, with NaN for
    the edges concerned, where an error exceeds a tenth of a value.  Raises `InputError` for unknown names, and for
    stresses that are zero somewhere.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> leverage = ce.edge_leverage(cf.optimize(cf.lattice("honeycomb", 2, 2), 'B_0')).value
    >>> round(leverage.before, 6), round(float(leverage.change[0]), 6)
    (0.288675, -0.057735)
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    name = of_kind(str, Quantity, name=name)
    network, sigma = critical.network, critical.sigma
    measured = quantity(network, name)
    require_valid(measured, critical)
    if not (sigma != 0).all():
        raise InputError("some edges have no stress: use the configuration of the taut part")
    manifold = critical.manifold
    solved, factor = manifold.solve(sigma), manifold.prestress.factorize_signed(sigma)
    L, m = solved.value.bond_vectors, network.n_edges
    kept, (after, errors, bypass, bypass_errors) = np.ones(m, bool), np.full((4, m), np.nan)
    width, steps = max(1, _BLOCK // m), 1
    known = solved.ok and np.abs(sigma).max() < LARGEST_RATIO * np.abs(sigma).min()
    for first in range(0, m if known else 0, width):
        edges = np.arange(first, min(first + width, m))
        columns, rounded, taken = _columns(network, sigma, factor, edges)
        bypass[edges], steps = _bypass(sigma, columns, edges, kept)[0], max(steps, taken)
        after[edges] = values_after(measured, network, sigma, L, columns, edges, kept, EXACT)
        errors[edges], bypass_errors[edges] = _MARGIN * EPS * np.abs([after[edges], bypass[edges]])
        for seed, other in enumerate(rounded):
            moved = L * (1 + EPS * _signs(seed, m, 1))
            there = values_after(measured, network, sigma, moved, other, edges, kept, EXACT)
            errors[edges] += _MARGIN * np.abs(there - after[edges])
            bypass_errors[edges] += _MARGIN * np.abs(_bypass(sigma, other, edges, kept)[0] - bypass[edges])
    before, status, note = measured.evaluate(solved.value)[0], solved.status, solved.note
    if solved.ok:
        unknown = np.isnan(bypass) | (errors > TRUSTED_ERROR * np.abs(after))
        after[unknown] = np.nan
        if unknown.any():
            status = Status.ill_conditioned
            note = f"rounding hides the cut of {unknown.sum()} edges: choose stresses of more similar magnitude"
    value = EdgeLeverage(measured.name, before, after, errors, bypass, bypass_errors)
    return Solution(value, status, Stats("rank-one updates", steps, residual=solved.stats.residual), note)


def _columns(network: Network, sigma: Array, factor: Factor, edges: IntArray) -> tuple[Array, list[Array], int]:
    """Columns of g P⁻¹ gᵀ (N_b, n), the same with two other sets of roundings, and the number of corrections."""
    g, own = network.free_incidence, np.arange(len(edges))

    def correction(columns: Array, bypass: Array, rounding: Array | float = 0.0) -> Array:
        # The load less the stress σr of its own edge is what flows around, which a difference would round.
        flow = sigma[:, None] * columns
        flow[edges, own] = -bypass
        return np.asarray(g @ factor.solve(-np.asarray(g.T @ (flow * (1 + rounding)))))

    columns = np.asarray(g @ factor.solve(np.asarray(g[edges].todense().T)))
    bypass = 1 - sigma[edges] * columns[edges, own]
    # Elongations, their energy and forces: each may be those of edges that the others leave out.
    weights, before, size, steps = np.abs(sigma) ** np.arange(3)[:, None], np.inf, 1.0, 0
    while _REFINED < size < _DECREASE * before and steps < _MOST_CORRECTIONS:
        change = correction(columns, bypass)
        columns, bypass, steps = columns + change, bypass - sigma[edges] * change[edges, own], steps + 1
        before, around = size if steps > 1 else np.inf, columns.copy()
        around[edges, own] = 0.0
        moved, all_around = weights @ change**2, weights @ around**2
        # Nothing flows around a bridge, and a loop loads nothing.
        size = float(np.sqrt(np.max(np.divide(moved, all_around, out=np.zeros_like(moved), where=all_around > 0))))
    # Differences of displacements have their rounding, and so have forces, which softer edges resist.
    rounded = []
    for seed in range(2):
        signs = EPS * _signs(seed, *columns.shape)
        other = columns + np.abs(columns[edges, own]) * signs
        rounded.append(other + correction(other, bypass - sigma[edges] * (other - columns)[edges, own], signs[:, ::-1]))
    return columns, rounded, steps


def _signs(seed: int, *shape: int) -> Array:
    """±1 without order."""
    return np.random.default_rng(seed).choice([-1.0, 1.0], shape)


def _bypass(sigma: Array, columns: Array, edges: IntArray, kept: Mask) -> tuple[Array, Array]:
    """1 − σr of each of n edges, and their columns (N_b, n) without the entry of the edge itself."""
    own = np.arange(len(edges))
    around = columns.copy()
    around[edges, own] = 0.0
    own_columns = columns[edges, own]
    # Columns of zeros are those of edges that are cut already, and of loops, which move nothing.
    bypass = np.divide(sigma @ around**2, own_columns, out=kept[edges].astype(float), where=own_columns != 0)
    return bypass, around


def _checked(name: str) -> Any:
    """An attribute of the part as a network of its own, which is made at the first use of one."""
    return property(lambda part: getattr(part.manifold.network, name))


class _PartOfNetwork:
    """Some of the edges of a network with the attributes that formulas use; what most of them use needs no checks.

    edges  (N_b,) mask
    """

    def __init__(self, network: Network, edges: Mask):
        self._whole, self._kept = network, edges
        self.stiffness, self.dimension = network.stiffness[edges], network.dimension
        self.n_edges = len(self.stiffness)

    @property
    def volume(self) -> float:
        return self._whole.volume

    @cached_property
    def manifold(self) -> CriticalManifold:
        """That of the part as a network of its own."""
        return CriticalManifold(self._whole.part(self._kept)[0])

    edges, offsets, cell, pins = map(_checked, ("edges", "offsets", "cell", "pins"))
    n_vertices, positions, faces, spacing = map(_checked, ("n_vertices", "positions", "faces", "spacing"))
    free, incidence, free_incidence, divergence = map(_checked, ("free", "incidence", "free_incidence", "divergence"))
    boundary_vectors, bond_vectors, with_stiffness = map(
        _checked, ("boundary_vectors", "bond_vectors", "with_stiffness")
    )


class Part:
    """Some of the edges of a network with their stress and bond vectors, of which quantities are evaluated.

    edges  (N_b,) mask
    """

    def __init__(self, network: Network, edges: Mask, sigma: Array, L: Array):
        self.network: Any = _PartOfNetwork(network, edges)
        self.sigma, self.bond_vectors = sigma[edges], L[edges]

    @property
    def manifold(self) -> CriticalManifold:
        """That of the part as a network of its own."""
        manifold: CriticalManifold = self.network.manifold
        return manifold


def in_part(measured: Quantity, network: Network, kept: Mask) -> Quantity | None:
    """The same quantity of the part of a network with the kept edges (N_b,), which has numbers of its own.

    A class of quantities that name an edge or a face by its number has a method `in_part(network, kept)`, which returns
    None where the part has lost it.  A quantity that names none is itself.
    """
    method = getattr(measured, "in_part", None)
    of_part: Quantity | None = method(network, kept) if method else measured
    return of_part


def value_of_part(measured: Quantity, network: Network, kept: Mask, sigma: Array, L: Array) -> float:
    """A quantity of the kept edges, with edges and faces numbered as in the network; NaN where it names a cut one."""
    length = norms(L)
    # Edges that hang on one vertex have no length: they are as good as cut.
    present = kept & (length > NO_LENGTH * length[kept].mean())
    of_part = in_part(measured, network, kept)
    if of_part is None or in_part(measured, network, present) is None:
        return np.nan
    part: Any = Part(network, kept, sigma, L)
    with np.errstate(all="ignore"):
        # Edges without length have no gradient.
        try:
            return of_part.evaluate(part)[0]
        except InputError:  # which the whole network does not meet, such as a source that straight chains hold
            return np.nan


def values_after(
    measured: Quantity,
    network: Network,
    sigma: Array,
    L: Array,
    columns: Array,
    edges: IntArray,
    kept: Mask,
    rounding: float = UPDATED,
) -> Array:
    """A quantity of the kept edges (N_b,) without each of n edges, NaN where the cut opens the network, (n,).

    columns   (N_b, n) of g P⁻¹ gᵀ
    rounding  of them, relative to r
    """
    bypass, around = _bypass(sigma, columns, edges, kept)
    opened = np.abs(bypass * sigma[edges]) <= rounding**2 * np.abs(sigma).sum()
    growth = sigma[edges] / np.where(opened, np.inf, bypass)
    form = stress_form(measured)
    if form is not None:
        stress, weight = np.where(kept, sigma, 0.0), np.where(kept, sigma**2 / network.stiffness, 0.0)
        if rounding == UPDATED:
            # Sums for all cuts at once cancel, by no more than the columns are off.
            work, _ = _sum_after(stress, L, L @ form.strain, around, edges, growth)
            cost, size = _sum_after(weight, L, L, around, edges, growth)
            opened |= cost <= rounding * size
        else:
            work, squares = _strained(form.strain, stress, L, growth * around, edges)
            cost = weight @ squares
            opened |= squares[kept].max(axis=0, initial=0.0) <= NO_LENGTH**2 * dot(L, L).max()
        cost = np.where(opened, np.nan, cost)
        return work**2 / (network.volume * cost) if form.squared else work / np.sqrt(cost)
    value, rest = np.full(len(edges), np.nan), kept.copy()
    for n in np.flatnonzero(~opened):
        rest[edges[n]] = False
        there = L + growth[n] * around[:, n, None] * L[edges[n]]
        length = norms(there)
        # Without stress nothing has a length: the rest collapses to a point.
        if length[rest].max(initial=0.0) > NO_LENGTH * norms(L).max():
            value[n] = value_of_part(measured, network, rest, sigma, there)
        rest[edges[n]] = kept[edges[n]]
    return value


def _strained(A: Array, stress: Array, L: Array, share: Array, edges: IntArray) -> tuple[Array, Array]:
    """Σ σ L'·A L' over all other edges after the cut of each of n edges, (n,), and |L'|² (N_b, n), L' = L + share L_α.

    Axis by axis: arrays whose last axis has the dimensions take ten times as long.
    """
    own = np.arange(len(edges))
    there = [L[:, axis, None] + share * L[edges, axis] for axis in range(L.shape[1])]
    for along in there:
        along[edges, own] = 0.0
    work = np.zeros(len(edges))
    for i, j in zip(*np.nonzero(A), strict=True):
        work += A[i, j] * (stress @ (there[i] * there[j]))
    return work, np.asarray(sum(along * along for along in there))


def _sum_after(
    weight: Array, L: Array, AL: Array, around: Array, edges: IntArray, growth: Array
) -> tuple[Array, Array]:
    """Σ w L·A L over all other edges after the cut of each of n edges, L → L + growth c L_α, (n,), and its terms' size.

    A is symmetric.
    """
    parts = weight * dot(L, AL)
    # The sum of all but one, without a difference.
    ahead = np.concatenate([[0.0], np.cumsum(parts)[:-1]])
    behind = np.concatenate([np.cumsum(parts[::-1])[-2::-1], [0.0]])
    rest = (ahead + behind)[edges]
    linear = 2 * growth * dot(around.T @ (weight[:, None] * L), AL[edges])
    square = growth**2 * dot(L, AL)[edges] * (weight @ around**2)
    return rest + linear + square, np.abs(rest) + np.abs(linear) + np.abs(square)
