"""Bounds on the strain at which cables become rigid: a floppy configuration below, balanced forces above.

A configuration with |L_α| < ℓ_α at some strain proves that the network is floppy there.  Forces f = σ L in balance
prove that it is rigid where Σ f·F b > Σ |f| ℓ: no coordinates can make every |L_α| ≤ ℓ_α.  Rounding enters both as
bounds on lengths, on sums, and on the unbalanced forces times the size of any admissible configuration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra

from critflow.networks import Array
from critflow.numerics import EPS, norms
from critflow.result import InputError
from critflow.taut_edges import OnsetState, newton_taut, settled
from critflow_extras.cables.boundary_path import BoundaryPath

# Relative decreases of the lengths that show a strain to be floppy where rounding alone is not enough.
RETREATS = (1e-12, 3e-11, 1e-10, 3e-10)
_CLOSE = 1e-10  # distance of a bound, relative to 1 + |γ|, beyond which those from the start are tried too


class StrainBounds(NamedTuple):
    """Floppy at strain `lower`, rigid at `upper`; each is a proof, or an estimate where no proof was found."""

    lower: float
    upper: float
    proven: tuple[bool, bool]


def onset_bounds(
    path: BoundaryPath, lengths: Array, state: OnsetState, start: OnsetState, interior: tuple[Array, Array]
) -> StrainBounds:
    """Bounds on the onset strain s from a state at or close to it.

    start     solution of the cone program, or the end of the central path
    interior  free components and coordinates at strain zero with all |L| < ℓ
    """
    lower, forces = _retreat(path, lengths, state), Forces(path, lengths, state)
    if path.linear:
        near = (_mixed(path, lengths, one, interior) for one in ((state, start) if lower is None else (state,)))
        lower = max((s for s in (lower, *near) if s is not None), default=None)
    upper = forces.rigid_strain() if path.linear or not path.n_free else _advance(path, lengths, state)
    if upper is None or upper - state.strain > _CLOSE * (1 + state.strain):
        other = Forces(path, lengths, start).rigid_strain()
        upper = min((s for s in (upper, other) if s is not None), default=None)
    # Without a proof: the error of the lengths over their rate.
    estimate = 2 * max(state.error, EPS) / forces.rate * forces.virtual_length if np.isfinite(state.error) else np.inf
    return StrainBounds(
        lower if lower is not None else state.strain - estimate,
        upper if upper is not None else state.strain + estimate,
        (lower is not None, upper is not None),
    )


def admissible(path: BoundaryPath, lengths: Array, s: float, q: Array, x: Array) -> bool:
    """Whether all |L| < ℓ, with the rounding of L."""
    return bool((norms(path.bond_vectors(s, q, x)) * (1 + 4 * EPS) + _rounding(path, s, q, x) < lengths).all())


def _rounding(path: BoundaryPath, s: float, q: Array, x: Array) -> Array:
    """Bound on the rounding error of |L|, (N_b,)."""
    d, F = path.network.dimension, path.gradient(s, q)
    size = abs(path.network.free_incidence) @ np.abs(x) + np.abs(path.network.boundary_vectors) @ np.abs(F).T
    return np.asarray((d + 4) * EPS * np.linalg.norm(size, axis=1))


def _retreat(path: BoundaryPath, lengths: Array, state: OnsetState) -> float | None:
    """The onset of slightly shorter lengths, whose taut edges are all shorter than ℓ.

    Slack edges that are exactly as long as ℓ without tension, as in lattices, need more than rounding.
    """
    if not np.isfinite(state.error):
        return None
    # Each edge by its own rounding and error, or the shortest would decide on all.
    rounding = _rounding(path, state.strain, state.free, state.coordinates) / lengths
    excess = np.maximum(state.ratios(path, lengths) - 1, 0.0)
    own = np.where(state.taut, excess, 0.0)
    for margin in (4 * np.maximum(rounding, own), 4 * np.maximum(rounding, state.error), *RETREATS):
        shorter = newton_taut(path, (1 - margin) * lengths, state)
        try:
            if shorter is None or shorter.strain > state.strain:
                return None
            shorter = settled(path, lengths, shorter)
            if admissible(path, lengths, shorter.strain, shorter.free, shorter.coordinates):
                return shorter.strain
        except InputError:
            return None
    return None


def _advance(path: BoundaryPath, lengths: Array, state: OnsetState) -> float | None:
    """The onset of slightly longer lengths, whose forces balance at the boundary there.

    Where the free components of the cell turn with the strain, forces that balance at one strain do not at another.
    """
    for margin in RETREATS:
        longer = newton_taut(path, (1 + margin) * lengths, state)
        if longer is None or longer.strain < state.strain:
            return None
        if Forces(path, lengths, longer).excess(longer.strain) > 0:
            return longer.strain
    return None


def _mixed(path: BoundaryPath, lengths: Array, state: OnsetState, interior: tuple[Array, Array]) -> float | None:
    """A convex combination with the interior point at strain zero, where bond vectors are linear in the unknowns."""
    size, (q_0, x_0) = state.ratios(path, lengths), interior
    inner = norms(path.bond_vectors(0.0, q_0, x_0))
    rounding = _rounding(path, state.strain, state.free, state.coordinates) / lengths
    # Each edge is convex in the weight.
    weight = 2 * float(((np.maximum(size - 1, 0.0) + rounding) / (1 - inner / lengths)).max())
    for _ in range(3):
        if not weight < 1:
            return None
        s, q = (1 - weight) * state.strain, (1 - weight) * state.free + weight * q_0
        if admissible(path, lengths, s, q, (1 - weight) * state.coordinates + weight * x_0):
            return s
        weight *= 4
    return None


class Forces:
    """Forces f = σ L of a state, nearly in balance."""

    def __init__(self, path: BoundaryPath, lengths: Array, state: OnsetState):
        network, sigma = path.network, np.maximum(state.sigma, 0.0)
        self.path, self.state, self.used = path, state, sigma > 0
        L = state.bond_vectors(path)[self.used]
        self.force = sigma[self.used, None] * L
        self.boundary = network.boundary_vectors[self.used]
        size = np.linalg.norm(self.force, axis=1)
        self.virtual_length = float(np.sum(size * lengths[self.used]))
        rates = path.rates(state.strain, state.free)
        self.rate = float(np.einsum("ai,ij,aj->", self.force, rates[-1], self.boundary))
        g = network.free_incidence[self.used]
        unbalanced = np.abs(g.T @ self.force).sum(axis=1) + 8 * network.dimension * EPS * (abs(g).T @ size)
        reach = _reach(path, lengths, state)
        # Vertices without stressed edges have neither force nor, where nothing joins them, a bound.
        met = unbalanced > 0
        self.margin = float(unbalanced[met] @ reach[met])
        self._lengths = lengths

    def excess(self, s: float) -> float:
        """Σ f·F b − Σ |f| ℓ less all rounding: positive only where no admissible coordinates exist."""
        moved = self.boundary @ self.path.gradient(s, self.state.free).T
        terms = self.force * moved
        size = float(np.abs(terms).sum()) + self.virtual_length
        # Sums are pairwise over blocks of at most 16 additions.
        return float(terms.sum()) - self.virtual_length - self.margin - self._free_margin(s) - 64 * EPS * size

    def _free_margin(self, s: float) -> float:
        """The largest work on the free components of the cell that balance to rounding, to any admissible ones."""
        if not self.path.n_free:
            return 0.0
        strains = self.path.rates(s, self.state.free)[:-1]
        free = np.abs(np.einsum("ai,mij,aj->m", self.force, strains, self.boundary))
        size = np.linalg.norm(self.force, axis=1) @ np.linalg.norm(self.boundary, axis=1)
        free += 8 * self.path.network.dimension * EPS * float(size)
        return float(free.sum()) * _largest_change(self.path, self._lengths, s, self.state.free)

    def rigid_strain(self) -> float | None:
        """A strain close above that of the state where the forces prove the network rigid."""
        if not self.rate > 0:
            return None
        s = self.state.strain
        step = max(2 * abs(self.excess(s)) / self.rate, EPS)
        for _ in range(4):
            try:
                if self.excess(s + step) > 0:
                    return s + step
            except InputError:
                return None
            step *= 4
        return None


def _reach(path: BoundaryPath, lengths: Array, state: OnsetState) -> Array:
    """Bound on the coordinates |x_i| (n_free,) of all admissible configurations at strains near that of the state.

    Along a path of edges from a fixed vertex coordinates change by less than Σ (ℓ + |F b|).
    """
    network = path.network
    F = np.linalg.norm(path.gradient(state.strain, state.free), 2)
    weight = lengths + 2 * F * np.linalg.norm(network.boundary_vectors, axis=1)
    tail, head = network.edges.T
    graph = sp.coo_array((weight, (tail, head)), shape=(network.n_vertices,) * 2)
    # Of parallel edges a coordinate format adds the weights, which keeps the bound valid.
    fixed = np.setdiff1d(np.arange(network.n_vertices), network.free)
    distance = dijkstra(graph.tocsr(), directed=False, indices=fixed, min_only=True)
    return np.asarray(distance[network.free])


def _largest_change(path: BoundaryPath, lengths: Array, s: float, q: Array) -> float:
    """Bound on the change of free components from q to those of any admissible configuration at a strain.

    No loop around the cell is longer than Σ ℓ, and a shear is twice its entry in the strain of the cell.
    """
    network = path.network
    spans = network.cell if network.cell is not None else np.array(list(network.pins.values()))
    affine = path.deformation.gradient(path.direction * s)
    least = float(np.linalg.svd(spans @ affine.T, compute_uv=False).min())
    return 2 * (1 + float(lengths.sum()) / least) + float(np.abs(q).max()) if least > 0 else np.inf
