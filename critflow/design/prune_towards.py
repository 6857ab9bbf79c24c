"""Pruning towards a target: edges are cut one at a time with the stress of the others unchanged.

All values after the next cut follow from C = g P⁻¹ gᵀ, which a cut changes by a matrix of rank one, and the bond
vectors with it: with its column c of edge α and r = C_αα,
    C → C + σ_α c cᵀ/(1 − σ_α r),   L → L + σ_α c L_αᵀ/(1 − σ_α r).
No matrix is factorised while the identities of C and the balance of forces hold to a bound; beyond it C is computed
again from the edges that remain.

Towards a target each cut brings the value nearest to it, until none brings it nearer.  Where it is then still far, the
last cuts are taken back, and others that do not go beyond the target follow in their place; at last so do those of a
search in random order, whose smaller steps leave more choices.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.linalg.blas import dger

from critflow.arguments import checked, generator
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.design.problem import Target, parse_targets
from critflow.linalg.tolerances import LARGEST_DENSE
from critflow.networks.network import Array, IntArray, Network
from critflow.networks.pruning import pruned
from critflow.progress import tell
from critflow.quantities.largest_modulus import NO_LENGTH
from critflow.quantities.leverage import Part, values_after
from critflow.result import InputError, Solution, Stats, Status

PRUNING_DRIFT = 1e-10  # error of rank-one updates from which P is factorised again: far below the digits of a design
PRUNING_REACHED = 1e-3  # distance from a target that counts as reached, relative to it: cuts are discrete

# Cuts that are taken back at most: at N_v = 60 more of them reach no further target within 1e-3.
_TAKEN_BACK = 6
# The column of C that is checked changes from cut to cut.
_PRIME = 7919


@dataclass(frozen=True, eq=False, kw_only=True)
class PrunedDesign(Solution[CriticalConfiguration]):
    """A configuration of a part of the edges, with the stress that they had.

    cuts            edges in the order of their cuts, by their index in the whole network
    edges           (n,) edges of the configuration, likewise; those that a cut leaves hanging are not among them
    values          quantity before the first cut and after each one
    factorisations  of P: 1 without drift, and the one of the returned configuration
    drift           |value − exact| of the last value, relative to the exact one of the returned configuration
    """

    cuts: IntArray
    edges: IntArray
    values: Array = field(repr=False)
    factorisations: int
    drift: float

    @property
    def objective(self) -> float:
        """Value of the quantity after the last cut."""
        return float(self.values[-1])


@checked
def prune_towards(
    critical: CriticalConfiguration | Network,
    targets: Mapping[Any, Any],
    cuts: int | None = None,
    seed: int | None = None,
    tolerance: float = PRUNING_REACHED,
    drift: float = PRUNING_DRIFT,
    throw: bool = True,
) -> PrunedDesign:
    """Cut edges of a critical configuration until a quantity is near a target, or a number of edges at least loss.

    critical   to start from; of a network, the configuration with σ = k
    targets    one quantity, by name or a `Quantity`, → value, or "largest" or "smallest" after every cut
    cuts       largest number of cuts; with a target as many as reduce its distance by default
    seed       None: each cut is the best one (greedy).  A number: edges are tried in random order, and cut if the
               distance from the target becomes smaller; without a target all are
    tolerance  distance from the target, relative to it, that counts as reached
    drift      error of the identities of C, and of the balance of forces over the mean tension, from which P is
               factorised again

    Cuts are discrete: `Status.not_reached` where no further cut reduces the distance from the target, and others in
    place of the last ones leave it larger than the tolerance.  `Status.floppy` where every further cut opens the
    network.  A search cut by cut is not exhaustive: other sets of edges may be nearer.
    Raises `InputError` for unknown quantities, stresses with zeros, networks beyond about 4,000 edges, and without
    target and number of cuts.
    """
    if isinstance(critical, Network):
        critical = CriticalManifold(critical).configuration(critical.stiffness)
    goal = _goal(critical, targets, cuts)
    search, limit = _Search(critical, goal, drift, seed), critical.network.n_edges if cuts is None else cuts
    search.follow(limit)
    near, status, note = tolerance * goal.low, Status.ok, ""
    if goal.goal and len(search.cuts) < limit:
        status, note = Status.floppy, "every further cut opens the network"
    if not goal.goal and not search.distance() <= near:
        search = _without_overshoot(search, near, limit) or search
    if not goal.goal and seed is None and not search.distance() <= near:
        other = _Search(critical, goal, drift, 0)
        other.follow(limit)
        reached = other if other.distance() <= near else _without_overshoot(other, near, limit)
        search = reached or search
    values = search.values
    if not goal.goal and not search.distance() <= near:
        status, place = Status.not_reached, f"{values[-1]:.6g} after {len(search.cuts)} cuts"
        note = f"{goal.name} is {place}: no further one is nearer to {goal.low:.6g}"
    configuration, edges = search.result()
    exact = goal.quantity.evaluate(configuration)[0]
    solution = PrunedDesign(
        value=configuration,
        status=status,
        stats=Stats("rank-one updates", len(search.cuts), np.nan if goal.goal else abs(values[-1] / goal.low - 1)),
        note=note,
        cuts=np.array(search.cuts, dtype=np.int64),
        edges=edges,
        values=np.array(values),
        factorisations=search.factorisations + 1,
        drift=abs(values[-1] - exact) / max(abs(exact), np.finfo(float).tiny),
    )
    return solution.or_raise("the cuts did not lead to the target") if throw else solution


def _goal(critical: CriticalConfiguration, targets: Mapping[Any, Any], cuts: int | None) -> Target:
    """The target, after checks of all arguments."""
    network = critical.network
    goal, *more = parse_targets(network, targets)
    if more or not (goal.goal or goal.low == goal.high > 0):
        raise InputError("pruning has one target, a positive number, or 'largest' or 'smallest': such as {'B_0': 0.1}")
    if goal.goal and cuts is None:
        raise InputError("give a target, a number of cuts, or both")
    if cuts is not None and not 0 <= cuts < network.n_edges:
        raise InputError(f"the number of cuts must be from 0 to {network.n_edges - 1}, not {cuts}")
    if not (critical.sigma != 0).all():
        raise InputError("some edges have no stress: use the configuration of the taut part")
    if network.n_edges**2 > LARGEST_DENSE:
        raise InputError(f"{network.n_edges}² numbers are too many: use edge_leverage, one cut at a time")
    return goal


def _without_overshoot(ended: _Search, tolerance: float, limit: int) -> _Search | None:
    """A search that reaches the target, without the last cuts of another, by cuts that do not go beyond it, or None."""
    for back in range(1, 1 + min(_TAKEN_BACK, len(ended.cuts))):
        search = _Search(ended.critical, ended.target, ended.bound, None)
        for earlier in ended.cuts[:-back]:
            search.cut(earlier)
        side = np.sign(search.values[-1] - search.target.low)
        while len(search.cuts) < limit:
            values = search.after_all()
            gap = side * (values - search.target.low)
            edge, distance = search.best(np.where(gap >= -tolerance, values, np.nan))
            if edge is None or distance >= search.distance():
                break
            search.cut(edge)
            if distance <= tolerance:
                return search
    return None


class _Search:
    """The edges that remain and have a length (`kept`), C of them, and their bond vectors."""

    def __init__(self, critical: CriticalConfiguration, target: Target, bound: float, seed: int | None):
        self._network, self._manifold = critical.network, CriticalManifold(critical.network)
        self.critical, self.target, self._goal, self.bound = critical, target, target.quantity, bound
        m = critical.network.n_edges
        self.sigma, self.kept, self.cuts, self.factorisations = critical.sigma.copy(), np.ones(m, bool), list[int](), 0
        # Edges in random order, the next one last.
        self.untried = None if seed is None else generator(seed).permutation(m).tolist()
        self._factorise()
        self.values = [self.value()]

    def follow(self, limit: int) -> None:
        """Cut edges until no further one is cut, or up to a limit."""
        while len(self.cuts) < limit and (edge := self.next_edge()) is not None:
            self.cut(edge)
            tell(f"cut {len(self.cuts)}")

    def distance(self) -> float:
        """Distance of the last value from the target; infinite where the largest or smallest is sought."""
        return np.inf if self.target.goal else abs(self.values[-1] - self.target.low)

    def best(self, values: Array) -> tuple[int | None, float]:
        """Place of the best value, and its distance from the target; None where all cuts open the network."""
        if not np.isfinite(values).any():
            return None, np.inf
        distance = self.target.goal * values if self.target.goal else np.abs(values - self.target.low)
        best = int(np.nanargmin(distance))
        return best, float(distance[best])

    def _factorise(self) -> None:
        g = self._manifold.network.free_incidence
        balance = self._manifold.balance(self.sigma)
        self.L = balance.bond_vectors
        self.C = np.ascontiguousarray(g @ balance.factor.solve(g.T.toarray()))
        self.factorisations += 1

    def value(self) -> float:
        """The quantity of the edges that remain."""
        with np.errstate(all="ignore"):
            return self._goal.evaluate(Part(self._network, self.kept, self.sigma, self.L))[0]

    def after(self, first: int, last: int) -> Array:
        """The quantity after the cut of each edge from `first` to `last`, NaN where it opens the network."""
        edges = np.arange(first, last)
        values = values_after(self._goal, self._network, self.sigma, self.L, self.C[:, first:last], edges, self.kept)
        return np.where(self.kept[edges], values, np.nan)

    def after_all(self) -> Array:
        """The quantity after the cut of each edge, (N_b,), NaN for those that do not remain."""
        m = len(self.kept)
        of_stress = self._goal.of_stress(self._network.dimension)
        width = m if of_stress else max(1, LARGEST_DENSE // (4 * self.L.size))
        return np.concatenate([self.after(first, min(first + width, m)) for first in range(0, m, width)])

    def next_edge(self) -> int | None:
        """The edge that is cut next, or None where every cut opens the network or is away from the target."""
        if self.untried is None:
            best, distance = self.best(self.after_all())
            return best if distance < self.distance() else None
        while self.untried:
            edge = self.untried.pop()
            if self.kept[edge]:
                best, distance = self.best(self.after(edge, edge + 1))
                if best is not None and distance < self.distance():
                    return int(edge)
        return None

    def cut(self, edge: int) -> None:
        """Cut an edge by updates of rank one, or by a new factorisation where their errors exceed the bound."""
        column, stress = self.C[:, edge].copy(), self.sigma[edge]
        growth = stress / (1 - stress * column[edge])
        self.L += growth * np.outer(column, self.L[edge])
        # C is symmetric, so that its transpose has the order of BLAS and is updated in place.
        dger(growth, column, column, a=self.C.T, overwrite_a=True)
        self.sigma[edge], self.kept[edge] = 0.0, False
        self.cuts.append(edge)
        if not self.error() <= self.bound:
            self._factorise()
        # Edges that hang on one vertex have no length, and change nothing.
        lengths = np.linalg.norm(self.L, axis=1)
        self.kept &= lengths > NO_LENGTH * lengths[self.kept].mean()
        self.values.append(self.value())

    def error(self) -> float:
        """Error of σCσC = σC in one entry, and of the balance of forces over the mean tension."""
        edges = np.flatnonzero(self.kept)
        probe = edges[_PRIME * len(self.cuts) % len(edges)]
        column = self.C[:, probe]
        of_C = abs(self.sigma[probe] * (column @ (self.sigma * column) - column[probe]))
        force = self._manifold.network.divergence @ (self.sigma[:, None] * self.L)
        mean = np.abs(self.sigma * np.linalg.norm(self.L, axis=1))[edges].mean()
        return float(max(of_C, np.abs(force).max(initial=0.0) / mean))

    def result(self) -> tuple[CriticalConfiguration, IntArray]:
        """The configuration of the edges that remain, solved from their stresses, and their indices."""
        network, edges, _ = pruned(self._network, self.kept)
        return CriticalManifold(network).configuration(self.critical.sigma[edges]), edges
