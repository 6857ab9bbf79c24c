"""Uniqueness of the self-stress of a configuration: proved vertex by vertex, and counted where that fails.

A self-stress balances at every vertex.  Where z edges meet whose directions have rank r, balanced stresses have z − r
degrees of freedom: one where three edges of the plane, or four in space, meet in general directions.  There every
self-stress is a multiple of the known one, by a factor shared by vertices with a common stressed edge, so a connected
network of such vertices has no other.  The cost is a few sums over the edges, without a matrix; a count by singular
values (`spectrum`) costs a factorisation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from critflow.certificates.spectrum import Spectrum, edge_without_length
from critflow.critical.manifold import CriticalConfiguration
from critflow.networks.blocks import components
from critflow.networks.network import Array, Network, validated_coordinates
from critflow.result import InputError

UNKNOWN_ERROR = 1e-8  # relative error assumed for bond vectors without error bounds
# Two directions differ if they do by this number times their errors, plus the rounding of products.
DIRECTION_MARGIN, DIRECTION_ROUNDING = 10.0, 1e-14


def require_only_self_stress(critical: CriticalConfiguration, instead: str) -> None:
    """Raise `InputError` for several self-stresses, or where rounding hides their number.

    instead  advice for the message
    """
    several = count_self_stresses(critical)
    if several is None:
        raise InputError(f"this requires one self-stress and rounding hides their number: {instead}")
    if several > 1:
        raise InputError(f"this requires one self-stress and the configuration has {several} or more: {instead}")


def count_self_stresses(critical: CriticalConfiguration) -> int | None:
    """Number of self-stresses, or a lower bound above one that counting coordinates gives; None: rounding hides it."""
    network = critical.network
    certain = network.least_self_stresses
    if certain > 1:
        return certain
    if only_self_stress(critical):
        return 1
    x = validated_coordinates(network, critical.coordinates)
    if edge_without_length(np.linalg.norm(network.bond_vectors(x), axis=1)):
        return None
    spectrum = Spectrum(network, x)
    return None if spectrum.doubt(*spectrum.gap) else spectrum.n_self_stresses


def only_self_stress(critical: CriticalConfiguration) -> bool:
    """Whether the directions of the edges alone prove that σ is the only self-stress; False: undecided."""
    network, length = critical.network, critical.lengths
    tail, head = network.edges.T
    free = np.ones(network.n_vertices, bool)
    free[list(network.pins)] = False
    # The stress of an edge between pins, or from a vertex to an image of it, is not restricted by balance.
    if not (critical.sigma.all() and (length > 0).all() and (tail != head).all() and (free[tail] | free[head]).all()):
        return False
    errors = critical.bond_errors / length
    errors = np.where(np.isfinite(errors), errors, UNKNOWN_ERROR)
    freedom = _freedom(network, critical.bond_vectors / length[:, None], errors)
    # The edges between free vertices connect all of these.
    n_parts = int(components(network.edges[free[network.edges].all(axis=1)], network.n_vertices).max()) + 1
    return bool((freedom[free] <= 1).all()) and n_parts - int(np.count_nonzero(~free)) == 1


def _freedom(network: Network, units: Array, errors: Array) -> NDArray[np.int64]:
    """z − r at each vertex, (N_v,), from unit vectors (N_b, d) of the edges and relative errors of them (N_b,).

    Error bound (proof): never less than in exact arithmetic, if the errors are bounds.
    """
    n, d = network.n_vertices, network.dimension
    tail, head = network.edges.T
    vertex = network.edges.T.ravel()
    met = np.bincount(vertex, minlength=n)
    if d == 2:
        # Rank 2 where some edge is not parallel to an arbitrary one of the vertex.
        one = np.zeros(n, int)
        one[tail] = one[head] = np.arange(network.n_edges)
        x, y = units.T
        apart = []
        for end in (tail, head):
            other = one[end]
            cross = np.abs(x * y[other] - y * x[other])
            apart.append(cross > DIRECTION_MARGIN * (errors + errors[other]) + DIRECTION_ROUNDING)
        rank = np.minimum(met, 1) + (np.bincount(vertex, np.concatenate(apart), n) > 0)
        return met - rank
    spread, wrong = np.zeros((n, d, d)), np.zeros(n)
    for end in (tail, head):
        np.add.at(spread, end, units[:, :, None] * units[:, None, :])
        np.add.at(wrong, end, errors)
    # Eigenvalues are squares of the singular values of the directions, so half of the digits remain.
    rounding = 2 * DIRECTION_MARGIN * wrong + DIRECTION_ROUNDING * met
    return met - (np.linalg.eigvalsh(spread) > rounding[:, None]).sum(axis=1)
