"""Whether the self-stress of a configuration is its only one: shown vertex by vertex, and counted where that fails.

A self-stress balances at each vertex by itself.  Where z edges meet whose directions have rank r, the stresses that do
have z − r degrees of freedom: a single one where three edges of the plane, or four in space, meet in general
directions.  There every self-stress is a multiple of the known one, by a factor that stressed edges carry to the next
vertex, so a connected network of such vertices has no other.  This takes a few sums over the edges and no matrix.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from critflow.critical.manifold import CriticalConfiguration, require_one_self_stress
from critflow.networks.network import Array, Network
from critflow.result import InputError, Status
from critflow.rigidity.counts import rigidity

# Relative error of bond vectors whose errors are not known.
_UNKNOWN = 1e-8
# Directions differ where they do by so many times their errors and the rounding of products of them.
_SAFETY, _ROUNDING = 10.0, 1e-14


def require_only_self_stress(critical: CriticalConfiguration, instead: str) -> None:
    """Refuse configurations with several self-stresses, or whose rounding hides how many there are."""
    require_one_self_stress(critical.network, instead)
    if only_self_stress(critical):
        return
    counts = rigidity(critical.network, critical.coordinates)
    several = counts.value.n_self_stresses
    if counts.status is Status.singular:
        raise InputError(f"this holds for one self-stress and rounding hides how many there are: {instead}")
    if several > 1:
        raise InputError(f"this holds for one self-stress and the configuration has {several}: {instead}")


def only_self_stress(critical: CriticalConfiguration) -> bool:
    """Whether the directions of the edges alone show that there is no self-stress but σ; False leaves it open."""
    network, sigma, length = critical.network, critical.sigma, critical.lengths
    tail, head = network.edges.T
    held = np.ones(network.n_vertices, bool)
    held[list(network.pins or {})] = False
    # Balance asks nothing of an edge between pins, or from a vertex to its own image.
    if not (length > 0).all() or (tail == head).any() or not (held[tail] | held[head]).all():
        return False
    errors = critical.bond_errors / length
    directions = _Directions(
        network, critical.bond_vectors / length[:, None], np.where(np.isfinite(errors), errors, _UNKNOWN)
    )
    known = sigma != 0
    if known.all():
        loose = directions.freedom(None)
        return bool((loose[held] <= 1).all()) and _joined(network, held, known)
    stressed = np.zeros(network.n_vertices, bool)
    stressed[network.edges[known]] = True
    stressed &= held
    if not ((directions.freedom(None)[stressed] <= 1).all() and _joined(network, stressed, known)):
        return False
    # Edges without stress have none in any self-stress next to a stressed vertex, nor where they alone must balance.
    open_edges = ~(stressed[tail] | stressed[head])
    while open_edges.any():
        settled = held & (directions.freedom(open_edges) == 0)
        closed = open_edges & (settled[tail] | settled[head])
        if not closed.any():
            return False
        open_edges &= ~closed
    return True


def _joined(network: Network, vertices: NDArray[np.bool_], edges: NDArray[np.bool_]) -> bool:
    """Whether the edges join these vertices, by ways that do not pass others."""
    tail, head = network.edges[edges & vertices[network.edges].all(axis=1)].T
    graph = sp.coo_array((np.ones(len(tail)), (tail, head)), shape=(network.n_vertices,) * 2)
    n_parts = connected_components(graph, directed=False)[0]
    return bool(n_parts - np.count_nonzero(~vertices) == 1)


class _Directions:
    """Unit vectors (N_b, d) of the edges, and relative errors of them (N_b,)."""

    def __init__(self, network: Network, units: Array, errors: Array):
        self._network, self._units, self._errors = network, units, errors

    def freedom(self, edges: NDArray[np.bool_] | None) -> NDArray[np.int64]:
        """z − r at each vertex, counting these edges only (None: all); never less than in exact arithmetic, (N_v,)."""
        network, units, errors = self._network, self._units, self._errors
        ends = network.edges
        if edges is not None:
            ends, units, errors = ends[edges], units[edges], errors[edges]
        n, d = network.n_vertices, network.dimension
        tail, head = ends.T
        vertex = np.concatenate([tail, head])
        met = np.bincount(vertex, minlength=n)
        if d == 2:
            # Rank 2 where some edge is not parallel to one of them, whichever that is.
            one = np.zeros(n, int)
            one[tail] = one[head] = np.arange(len(ends))
            x, y = units.T
            apart = []
            for end in (tail, head):
                other = one[end]
                cross = np.abs(x * y[other] - y * x[other])
                apart.append(cross > _SAFETY * (errors + errors[other]) + _ROUNDING)
            rank = np.minimum(met, 1) + (np.bincount(vertex, np.concatenate(apart), n) > 0)
            return met - rank
        spread, wrong = np.zeros((n, d, d)), np.zeros(n)
        for end in (tail, head):
            np.add.at(spread, end, units[:, :, None] * units[:, None, :])
            np.add.at(wrong, end, errors)
        # Eigenvalues are the squares of what the directions span across; products lose half of the digits.
        return met - (np.linalg.eigvalsh(spread) > (2 * _SAFETY * wrong + _ROUNDING * met)[:, None]).sum(axis=1)
