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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.linalg.blas import dger

from critflow.arguments import generator, of_kind
from critflow.calls import running, tell
from critflow.manifold import NO_LENGTH, CriticalConfiguration, CriticalManifold
from critflow.networks import Array, IntArray, Network
from critflow.numerics import LARGEST_DENSE, norms
from critflow.quantities import require_valid
from critflow.result import InputError, Solution, Stats, Status
from critflow_extras.fronts.leverage import Mask, value_of_part, values_after
from critflow_extras.pruning.pruning import pruned
from critflow_extras.targets.problem import Target, parse_targets
from critflow_extras.targets.stress_form import stress_form

PRUNING_DRIFT = 1e-10  # error of rank-one updates from which P is factorised again: far below the digits of a design
PRUNING_REACHED = 1e-3  # distance from a target that counts as reached, relative to it: cuts are discrete

# Cuts that are taken back at most: at N_v = 60 more of them reach no further target within 1e-3.
_TAKEN_BACK = 6
# The column of C that is checked changes from cut to cut.
_PRIME = 7919


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class PrunedDesign(Solution[CriticalConfiguration]):
    """A configuration of a part of the edges, with the stress that they had.

    cuts    edges in the order of their cuts, by their index in the whole network
    edges   (n,) edges of the configuration, likewise; those that a cut leaves hanging are not among them
    values  quantity before the first cut and after each one
    """

    cuts: IntArray
    edges: IntArray
    values: Array = field(repr=False)

    @property
    def objective(self) -> float:
        """Value of the quantity after the last cut."""
        return float(self.values[-1])


@running("prune_towards")
def prune_towards(
    critical: CriticalConfiguration | Network,
    targets: Mapping[Any, Any],
    cuts: int | None = None,
    seed: int | None = None,
    tolerance: float = PRUNING_REACHED,
    throw: bool = True,
) -> PrunedDesign:
    """Cut edges of a critical configuration until a quantity is near a target, or a number of edges at least loss.

    critical   to start from; of a network, the configuration with σ = k
    targets    one quantity, by name or a `Quantity`, → value, or "largest" or "smallest" after every cut; numbers in
               the name are those of edges and faces of the network given, which are not cut
    cuts       largest number of cuts; with a target as many as reduce its distance by default
    seed       None: each cut is the best one (greedy).  A number: edges are tried in random order, and cut if the
               distance from the target becomes smaller; without a target all are
    tolerance  distance from the target, relative to it, that counts as reached

    Cuts are discrete: `Status.not_reached` where no further cut reduces the distance from the target, and others in
    place of the last ones leave it larger than the tolerance.  `Status.floppy` where every further cut opens the
    network.  A search cut by cut is not exhaustive: other sets of edges may be nearer.
    Raises `InputError` for unknown quantities, stresses with zeros, networks beyond about 4,000 edges, and without
    target and number of cuts.
    """
    critical = of_kind(CriticalConfiguration, Network, critical=critical)
    of_kind(Mapping, targets=targets)
    cuts, seed = of_kind(int, None, cuts=cuts, seed=seed)
    of_kind(float, tolerance=tolerance)
    of_kind(bool, throw=throw)
    if isinstance(critical, Network):
        critical = CriticalManifold(critical).configuration(critical.stiffness)
    target = _target_of(critical, targets, cuts)
    require_valid(target.quantity, critical)
    search, limit = _Search(critical, target), critical.network.n_edges if cuts is None else cuts
    near, status, note = tolerance * target.low, Status.ok, ""
    state = _followed(search, limit, seed, near)
    if not target.sense and seed is None and not search.distance(state) <= near:
        other = _followed(search, limit, 0, near)
        state = other if search.distance(other) <= near else state
    n_cuts, value = len(state.cuts), state.values[-1]
    if target.sense and n_cuts < limit:
        status, note = Status.floppy, "every further cut opens the network"
    if not target.sense and not search.distance(state) <= near:
        status = Status.not_reached
        note = f"{target.name} is {value:.6g} after {n_cuts} cuts: no further one is nearer to {target.low:.6g}"
    network, edges, _ = pruned(critical.network, state.kept)
    solution = PrunedDesign(
        value=CriticalManifold(network).configuration(critical.sigma[edges]),
        status=status,
        stats=Stats("rank-one updates", n_cuts, np.nan if target.sense else abs(value / target.low - 1)),
        note=note,
        cuts=np.array(state.cuts, dtype=np.int64),
        edges=edges,
        values=np.array(state.values),
    )
    return solution.or_raise("the cuts did not lead to the target") if throw else solution


def _target_of(critical: CriticalConfiguration, targets: Mapping[Any, Any], cuts: int | None) -> Target:
    """The target, after checks of all arguments."""
    network = critical.network
    target, *more = parse_targets(network, targets)
    if more or not (target.sense or target.low == target.high > 0):
        raise InputError("pruning has one target, a positive number, or 'largest' or 'smallest': such as {'B_0': 0.1}")
    if target.sense and cuts is None:
        raise InputError("give a target, a number of cuts, or both")
    if cuts is not None and not 0 <= cuts < network.n_edges:
        raise InputError(f"the number of cuts must be from 0 to {network.n_edges - 1}, not {cuts}")
    if not (critical.sigma != 0).all():
        raise InputError("some edges have no stress: use the configuration of the taut part")
    if network.n_edges**2 > LARGEST_DENSE:
        raise InputError(f"{network.n_edges}² numbers are too many: use edge_leverage, one cut at a time")
    return target


@dataclass(frozen=True, eq=False)
class _State:
    """The cuts and the values before and after them; σ, the edges that remain and have a length, L and C of these."""

    cuts: tuple[int, ...]
    values: tuple[float, ...]
    sigma: Array
    kept: Mask
    L: Array
    C: Array


class _Search:
    """States of the edges that remain after cuts, and their distances from the target."""

    def __init__(self, critical: CriticalConfiguration, target: Target):
        self.critical, self.target, self.quantity = critical, target, target.quantity
        self.network, self._manifold = critical.network, CriticalManifold(critical.network)

    def state(self, cuts: tuple[int, ...] = (), before: tuple[float, ...] = ()) -> _State:
        """The state after cuts by a factorisation, where the values before the last one are known."""
        sigma, g = self.critical.sigma.copy(), self.network.free_incidence
        sigma[list(cuts)] = 0.0
        balance = self._manifold.balance(sigma)
        C = np.ascontiguousarray(g @ balance.factor.solve(g.T.toarray()))
        return self._measured(cuts, before, sigma, balance.bond_vectors, C)

    def cut(self, state: _State, edge: int) -> _State:
        """The state after one more cut by updates of rank one, which take C over; by a factorisation where they err."""
        tell(f"cut {len(state.cuts) + 1}")
        cuts, column, stress = (*state.cuts, int(edge)), state.C[:, edge].copy(), state.sigma[edge]
        growth, sigma = stress / (1 - stress * column[edge]), state.sigma.copy()
        sigma[edge] = 0.0
        L = state.L + growth * np.outer(column, state.L[edge])
        # In place: new memory would cost more than the update.  C is symmetric, its transpose has the order of BLAS.
        C = dger(growth, column, column, a=state.C.T, overwrite_a=True).T
        updated = self._measured(cuts, state.values, sigma, L, C)
        return updated if self._error(updated) <= PRUNING_DRIFT else self.state(cuts, state.values)

    def _measured(self, cuts: tuple[int, ...], before: tuple[float, ...], sigma: Array, L: Array, C: Array) -> _State:
        kept, lengths = sigma != 0, norms(L)
        if cuts:
            # Edges that hang on one vertex have no length, and change nothing.
            kept &= lengths > NO_LENGTH * lengths[kept].mean()
        value = value_of_part(self.quantity, self.network, kept, sigma, L)
        return _State(cuts, (*before, value), sigma, kept, L, C)

    def _error(self, state: _State) -> float:
        """Error of σCσC = σC in one entry, and of the balance of forces over the mean tension."""
        sigma, edges = state.sigma, np.flatnonzero(state.kept)
        probe = edges[_PRIME * len(state.cuts) % len(edges)]
        column = state.C[:, probe]
        of_C = abs(sigma[probe] * (column @ (sigma * column) - column[probe]))
        tensions = sigma[:, None] * state.L
        force = np.abs(self.network.divergence @ tensions).max(initial=0.0)
        return float(max(of_C, force / norms(tensions[edges]).mean()))

    def after(self, state: _State, first: int, last: int) -> Array:
        """The quantity after the cut of each edge from `first` to `last`, NaN where it opens the network or is cut."""
        quick = stress_form(self.quantity)
        width = last - first if quick else max(1, LARGEST_DENSE // (4 * state.L.size))
        values, given = [], (self.quantity, self.network, state.sigma, state.L)
        for start in range(first, last, width):
            end = min(start + width, last)
            values.append(values_after(*given, state.C[:, start:end], np.arange(start, end), state.kept))
        return np.where(state.kept[first:last], np.concatenate(values), np.nan)

    def distances(self, values: Array) -> Array:
        """What a cut is to make least, of values after it; infinite where it opens the network."""
        distances = self.target.sense * values if self.target.sense else np.abs(values - self.target.low)
        return np.where(np.isfinite(values), distances, np.inf)

    def distance(self, state: _State) -> float:
        """Distance of the last value from the target; infinite where the largest or smallest is sought."""
        return np.inf if self.target.sense else abs(state.values[-1] - self.target.low)


def _followed(search: _Search, limit: int, seed: int | None, near: float) -> _State:
    """The state after cuts up to a limit, with the last ones replaced where the target is then not near."""
    m = search.network.n_edges
    # The last edge of a random order comes first.
    order = None if seed is None else generator(seed).permutation(m)[::-1]
    state = _greedy(search, search.state(), limit) if order is None else _in_order(search, limit, order)
    for back in range(1, 1 + (0 if search.target.sense else min(_TAKEN_BACK, len(state.cuts)))):
        if search.distance(state) <= near:
            break
        fewer = search.state(state.cuts[:-back], state.values[: -back - 1])
        other = _greedy(search, fewer, limit, near)
        state = other if search.distance(other) <= near else state
    return state


def _in_order(search: _Search, limit: int, order: Sequence[int] | IntArray) -> _State:
    """The state after the cut of each edge in an order that brings the value nearer."""
    state = search.state()
    for edge in order:
        if len(state.cuts) == limit:
            break
        if state.kept[edge] and search.distances(search.after(state, edge, edge + 1))[0] < search.distance(state):
            state = search.cut(state, edge)
    return state


def _greedy(search: _Search, state: _State, limit: int, near: float | None = None) -> _State:
    """The state after the best cuts, until none brings the value nearer.

    near  cuts do not go beyond the target by more, and end at this distance from it
    """
    target = search.target.low
    side = np.sign(state.values[-1] - target)
    while len(state.cuts) < limit:
        values = search.after(state, 0, search.network.n_edges)
        distances = search.distances(values)
        if near is not None:
            distances[side * (values - target) < -near] = np.inf
        edge = int(distances.argmin())
        if not distances[edge] < search.distance(state):
            break
        state = search.cut(state, edge)
        if near is not None and distances[edge] <= near:
            break
    return state
